// SPDX-License-Identifier: Apache-2.0
#include "comms/certificate.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <openssl/x509_vfy.h>

#include <array>
#include <stdexcept>

namespace covey {
namespace {

struct VerificationDeleter {
  void operator()(PKCS7* text) const { PKCS7_free(text); }
  void operator()(X509_STORE* store) const { X509_STORE_free(store); }
  void operator()(X509_STORE_CTX* context) const { X509_STORE_CTX_free(context); }
};
using SignedText = std::unique_ptr<PKCS7, VerificationDeleter>;
using TrustStore = std::unique_ptr<X509_STORE, VerificationDeleter>;
using Verification = std::unique_ptr<X509_STORE_CTX, VerificationDeleter>;

constexpr char kNoMemory[] = "reserve memory";

TextBuffer empty_buffer() {
  TextBuffer buffer(BIO_new(BIO_s_mem()));
  require_openssl(buffer != nullptr, kNoMemory);
  return buffer;
}

// Reads from `text`, which has to outlive it.
TextBuffer buffer_of(const std::string& text) {
  TextBuffer buffer(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
  require_openssl(buffer != nullptr, kNoMemory);
  return buffer;
}

std::string content_of(BIO& buffer) {
  std::string out(BIO_ctrl_pending(&buffer), '\0');
  const int read = BIO_read(&buffer, out.data(), static_cast<int>(out.size()));
  require_openssl(out.empty() || read == static_cast<int>(out.size()), "read its own text");
  return out;
}

TrustStore store_with(X509& authority) {
  TrustStore store(X509_STORE_new());
  require_openssl(store != nullptr && X509_STORE_add_cert(store.get(), &authority) == 1,
                  "trust an authority");
  return store;
}

std::string name_entry(const X509& certificate, int nid) {
  const X509_NAME* name = X509_get_subject_name(&certificate);
  const int index = X509_NAME_get_index_by_NID(name, nid, -1);
  if (index < 0) return "";
  const ASN1_STRING* text = X509_NAME_ENTRY_get_data(X509_NAME_get_entry(name, index));
  const auto* bytes = reinterpret_cast<const char*>(ASN1_STRING_get0_data(text));
  return {bytes, static_cast<std::size_t>(ASN1_STRING_length(text))};
}

}  // namespace

void require_openssl(bool good, const std::string& what) {
  if (good) return;
  std::array<char, 256> reason{};
  ERR_error_string_n(ERR_get_error(), reason.data(), reason.size());
  ERR_clear_error();
  throw std::runtime_error("OpenSSL cannot " + what + ": " + reason.data());
}

PrivateKey private_key_from(const std::string& pem) {
  return PrivateKey(PEM_read_bio_PrivateKey(buffer_of(pem).get(), nullptr, nullptr, nullptr));
}

Certificate certificate_from(const std::string& pem) {
  return Certificate(PEM_read_bio_X509(buffer_of(pem).get(), nullptr, nullptr, nullptr));
}

RevocationList revocation_list_from(const std::string& pem) {
  return RevocationList(PEM_read_bio_X509_CRL(buffer_of(pem).get(), nullptr, nullptr, nullptr));
}

std::string to_pem(EVP_PKEY& key) {
  const TextBuffer out = empty_buffer();
  const int written =
      PEM_write_bio_PrivateKey(out.get(), &key, nullptr, nullptr, 0, nullptr, nullptr);
  require_openssl(written == 1, "write a key");
  return content_of(*out);
}

std::string to_pem(X509& certificate) {
  const TextBuffer out = empty_buffer();
  require_openssl(PEM_write_bio_X509(out.get(), &certificate) == 1, "write a certificate");
  return content_of(*out);
}

std::string to_pem(X509_CRL& list) {
  const TextBuffer out = empty_buffer();
  require_openssl(PEM_write_bio_X509_CRL(out.get(), &list) == 1, "write a revocation list");
  return content_of(*out);
}

Subject subject_of(const X509& certificate) {
  return {name_entry(certificate, NID_organizationName), name_entry(certificate, NID_commonName)};
}

std::string distinguished_name(const Subject& subject) {
  return "CN=" + subject.name + ",O=" + subject.team;
}

std::optional<std::string> problem_with(X509& certificate, X509& authority, X509_CRL* revoked) {
  const TrustStore store = store_with(authority);
  if (revoked != nullptr)
    require_openssl(X509_STORE_add_crl(store.get(), revoked) == 1, "use a revocation list");
  const Verification verification(X509_STORE_CTX_new());
  require_openssl(verification != nullptr && X509_STORE_CTX_init(verification.get(), store.get(),
                                                                 &certificate, nullptr) == 1,
                  "verify a certificate");
  if (revoked != nullptr) X509_STORE_CTX_set_flags(verification.get(), X509_V_FLAG_CRL_CHECK);
  if (X509_verify_cert(verification.get()) == 1) return std::nullopt;
  return X509_verify_cert_error_string(X509_STORE_CTX_get_error(verification.get()));
}

std::string sign(const std::string& text, X509& signer, EVP_PKEY& key) {
  constexpr int kFlags = PKCS7_TEXT | PKCS7_DETACHED | PKCS7_NOSMIMECAP;
  const SignedText signature(PKCS7_sign(&signer, &key, nullptr, buffer_of(text).get(), kFlags));
  require_openssl(signature != nullptr, "sign a text");
  const TextBuffer out = empty_buffer();
  const int written = SMIME_write_PKCS7(out.get(), signature.get(), buffer_of(text).get(), kFlags);
  require_openssl(written == 1, "write a signed text");
  return content_of(*out);
}

std::optional<std::string> verified_text(const std::string& smime, X509& authority) {
  BIO* detached = nullptr;
  const SignedText signature(SMIME_read_PKCS7(buffer_of(smime).get(), &detached));
  const TextBuffer text(detached);
  if (signature == nullptr) return std::nullopt;
  const TextBuffer out = empty_buffer();
  const int verified = PKCS7_verify(signature.get(), nullptr, store_with(authority).get(),
                                    text.get(), out.get(), PKCS7_TEXT);
  ERR_clear_error();
  if (verified != 1) return std::nullopt;
  return content_of(*out);
}

}  // namespace covey
