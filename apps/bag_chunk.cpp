// SPDX-License-Identifier: Apache-2.0
#include "apps/bag_chunk.h"

#include <bzlib.h>
#include <lz4frame.h>
#include <zstd.h>

#include <memory>

#include "comms/byte_fields.h"

namespace covey {
namespace {

constexpr std::uint64_t kMaxChunk = std::uint64_t{1} << 30U;  // bytes

// Each: whether all of `packed` becomes exactly all of `plain`.
bool unpack_zstd(const Bytes& packed, Bytes& plain) {
  return ZSTD_decompress(plain.data(), plain.size(), packed.data(), packed.size()) == plain.size();
}

bool unpack_lz4(const Bytes& packed, Bytes& plain) {
  LZ4F_dctx* made = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&made, LZ4F_VERSION)) != 0U) return false;
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(
      made, &LZ4F_freeDecompressionContext);
  std::size_t written = plain.size(), taken = packed.size();
  const std::size_t still_expected =
      LZ4F_decompress(context.get(), plain.data(), &written, packed.data(), &taken, nullptr);
  return still_expected == 0 && written == plain.size() && taken == packed.size();
}

bool unpack_bz2(const Bytes& packed, Bytes& plain) {
  auto written = static_cast<unsigned>(plain.size());
  // The library knows no const; unpacking does not write there.
  auto* const source = reinterpret_cast<char*>(const_cast<std::uint8_t*>(packed.data()));
  const int result = BZ2_bzBuffToBuffDecompress(reinterpret_cast<char*>(plain.data()), &written,
                                                source, static_cast<unsigned>(packed.size()), 0, 0);
  return result == BZ_OK && written == plain.size();
}

}  // namespace

Bytes unpacked(const std::string& compression, const Bytes& packed, std::uint64_t size) {
  if (compression.empty() || compression == "none") return packed;
  const auto unpack = compression == "zstd"  ? unpack_zstd
                      : compression == "lz4" ? unpack_lz4
                      : compression == "bz2" ? unpack_bz2
                                             : nullptr;
  if (unpack == nullptr) throw Unreadable("chunks are compressed by " + compression);
  if (size > kMaxChunk || packed.size() > kMaxChunk) throw Unreadable("chunk too large");
  Bytes plain(size);
  if (!unpack(packed, plain)) throw Unreadable("chunk that cannot be unpacked");
  return plain;
}

}  // namespace covey
