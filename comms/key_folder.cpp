// SPDX-License-Identifier: Apache-2.0
#include "comms/key_folder.h"

#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "comms/certificate.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& file, const std::string& complaint) {
  throw std::runtime_error("link: security: " + file.string() + ' ' + complaint);
}

std::string make_it(const LinkConfig& config) {
  return "make it with `covey keys --out " + config.security + " --add " + config.agent +
         "` (a new team with --team " + config.team + ") and copy the folder to this drone";
}

std::string content_of(const LinkConfig& config, const char* name) {
  const fs::path file = key_folder(config) / name;
  std::ifstream stream(file, std::ios::binary);
  if (!stream) fail(file, "cannot be read: " + make_it(config));
  return {std::istreambuf_iterator<char>(stream), {}};
}

template <typename Value>
Value pem(const LinkConfig& config, const char* name, Value (*parse)(const std::string&)) {
  Value out = parse(content_of(config, name));
  if (out == nullptr) fail(key_folder(config) / name, "is damaged: " + make_it(config));
  return out;
}

void check_private(const fs::path& key) {
  using fs::perms;
  const perms others = fs::status(key).permissions() & (perms::group_all | perms::others_all);
  if (others != perms::none)
    fail(key, "can be read by others: chmod 600, and new keys if anybody has");
}

void check_owner(const LinkConfig& config, const X509& certificate) {
  const Subject owner = subject_of(certificate);
  if (owner.name == config.agent && owner.team == config.team) return;
  fail(key_folder(config) / kCertificateFile,
       "is that of " + owner.name + " in team " + owner.team + ", but this is " + config.agent +
           " in team " + config.team + ": correct agent.name or link.team, or " + make_it(config));
}

void check_identity(const LinkConfig& config) {
  const PrivateKey key = pem(config, kPrivateKeyFile, private_key_from);
  check_private(key_folder(config) / kPrivateKeyFile);
  const Certificate certificate = pem(config, kCertificateFile, certificate_from);
  check_owner(config, *certificate);
  const fs::path file = key_folder(config) / kCertificateFile;
  if (X509_check_private_key(certificate.get(), key.get()) != 1)
    fail(file, "does not belong to " + std::string(kPrivateKeyFile) + ": " + make_it(config));
  const Certificate authority = pem(config, kIdentityAuthorityFile, certificate_from);
  const RevocationList revoked = pem(config, kRevokedFile, revocation_list_from);
  if (const auto problem = problem_with(*certificate, *authority, revoked.get()))
    fail(file, "is not valid, " + *problem + ": " + make_it(config));
}

std::string check_signed(const LinkConfig& config, const char* name) {
  const Certificate authority = pem(config, kPermissionsAuthorityFile, certificate_from);
  const auto text = verified_text(content_of(config, name), *authority);
  if (!text)
    fail(key_folder(config) / name, "was not signed by the team's authority: " + make_it(config));
  return *text;
}

}  // namespace

fs::path key_folder(const LinkConfig& config) { return fs::path(config.security) / config.agent; }

void check_keys(const LinkConfig& config) {
  check_identity(config);
  check_signed(config, kGovernanceFile);
  const std::string subject = distinguished_name({config.team, config.agent});
  if (check_signed(config, kPermissionsFile).find(">" + subject + "<") == std::string::npos)
    fail(key_folder(config) / kPermissionsFile,
         "does not grant " + subject + " anything: " + make_it(config));
}

}  // namespace covey
