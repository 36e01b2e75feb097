// SPDX-License-Identifier: Apache-2.0
#include "apps/team_keys.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <system_error>

#include "apps/config_json.h"
#include "apps/folder_entries.h"
#include "apps/whole_file.h"
#include "comms/checks.h"
#include "comms/key_folder.h"
#include "comms/team_authority.h"
#include "sim/dataset_writer.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using std::chrono::hours;
using std::chrono::system_clock;

// No drone can have this name.
constexpr char kAuthorityFolder[] = "team.authority";
constexpr char kTeamFile[] = "team.json";
constexpr char kDronesFolder[] = "drones";
constexpr char kIdentityKeyFile[] = "identity_key.pem",
               kPermissionsKeyFile[] = "permissions_key.pem";
constexpr int kAuthorityDays = 3650;

[[noreturn]] void fail(const fs::path& what, const std::string& complaint) {
  throw std::runtime_error(what.string() + ": " + complaint);
}

// What is new is dated back: a drone's clock may be behind.
system_clock::time_point yesterday() { return system_clock::now() - hours(24); }

Validity valid_for(int days) { return {yesterday(), system_clock::now() + days * hours(24)}; }

void check_names(const std::vector<std::string>& drones) {
  std::set<std::string> known;
  for (const std::string& drone : drones) {
    if (!is_agent_name(drone))
      fail("keys", '"' + drone + "\" is not a name: use 1..32 characters of [A-Za-z0-9_-]");
    if (!known.insert(drone).second) fail("keys", drone + " is named twice");
  }
}

std::string content_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) fail(file, "cannot be read: is its folder one of `covey keys --team ...`?");
  return {std::istreambuf_iterator<char>(stream), {}};
}

void make_private_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (!error) fs::permissions(folder, fs::perms::owner_all, error);
  if (error) fail(folder, "cannot be made: " + error.message());
}

// In a folder that is private already, so that there is no moment at which others could read it.
void write_private_file(const fs::path& file, const std::string& content) {
  write_whole_file(file, content);
  fs::permissions(file, fs::perms::owner_read | fs::perms::owner_write);
}

// ----------------------------------------------------------------------------------- the authority

void write_authority(const fs::path& folder, const TeamAuthority& authority) {
  make_private_folder(folder);
  make_private_folder(folder / kDronesFolder);
  const nlohmann::json team = {{"team", authority.team},
                               {"first_domain", authority.domains.first},
                               {"last_domain", authority.domains.last}};
  write_private_file(folder / kTeamFile, team.dump(2) + "\n");
  write_private_file(folder / kIdentityKeyFile, authority.identity.key);
  write_private_file(folder / kIdentityAuthorityFile, authority.identity.certificate);
  write_private_file(folder / kPermissionsKeyFile, authority.permissions.key);
  write_private_file(folder / kPermissionsAuthorityFile, authority.permissions.certificate);
  write_private_file(folder / kRevokedFile, authority.revoked);
}

TeamAuthority read_authority(const fs::path& team_folder) {
  const fs::path folder = team_folder / kAuthorityFolder;
  TeamAuthority out;
  try {
    const auto team = nlohmann::json::parse(content_of(folder / kTeamFile));
    out.team = team.at("team").get<std::string>();
    out.domains = {team.at("first_domain").get<int>(), team.at("last_domain").get<int>()};
  } catch (const nlohmann::json::exception& error) {
    fail(folder / kTeamFile, std::string("is damaged: ") + error.what());
  }
  out.identity = {content_of(folder / kIdentityKeyFile),
                  content_of(folder / kIdentityAuthorityFile)};
  out.permissions = {content_of(folder / kPermissionsKeyFile),
                     content_of(folder / kPermissionsAuthorityFile)};
  out.revoked = content_of(folder / kRevokedFile);
  return out;
}

fs::path issued_certificate(const fs::path& team_folder, const std::string& drone) {
  return team_folder / kAuthorityFolder / kDronesFolder / (drone + ".pem");
}

bool is_authority(const fs::path& folder) {
  static const std::set<std::string> kFiles = {kTeamFile,           kIdentityKeyFile,
                                               kPermissionsKeyFile, kIdentityAuthorityFile,
                                               kRevokedFile,        kPermissionsAuthorityFile};
  return is_plain_folder(folder) && fs::exists(folder / kTeamFile) &&
         all_entries(folder, [&](const fs::path& entry) {
           if (entry.filename() != kDronesFolder)
             return is_plain_file(entry) && kFiles.count(entry.filename()) > 0;
           return is_plain_folder(entry) && all_entries(entry, [](const fs::path& certificate) {
                    return is_plain_file(certificate) && certificate.extension() == ".pem" &&
                           is_agent_name(certificate.stem());
                  });
         });
}

bool is_drones_folder(const fs::path& folder) {
  return is_agent_name(folder.filename()) &&
         holds_only(folder,
                    {kPrivateKeyFile, kCertificateFile, kIdentityAuthorityFile,
                     kPermissionsAuthorityFile, kRevokedFile, kGovernanceFile, kPermissionsFile});
}

// A team's, and nothing else.
bool is_key_folder(const fs::path& folder) {
  return is_authority(folder / kAuthorityFolder) && all_entries(folder, [](const fs::path& entry) {
           return entry.filename() == kAuthorityFolder || is_drones_folder(entry);
         });
}

// -------------------------------------------------------------------------------------- the drones

std::vector<std::string> drones_of(const fs::path& team_folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(team_folder / kAuthorityFolder / kDronesFolder))
    names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

void write_drone(const fs::path& folder, const KeyFiles& keys) {
  make_private_folder(folder);
  for (const auto& [name, content] : keys) write_private_file(folder / name, content);
}

void add_drone(const fs::path& team_folder, const TeamAuthority& authority,
               const std::string& drone, int days) {
  const KeyFiles keys = make_keys(authority, drone, valid_for(days));
  StagedFolder folder(team_folder / drone);
  write_drone(folder.path(), keys);
  write_private_file(issued_certificate(team_folder, drone), keys.at(kCertificateFile));
  folder.commit();
}

void refuse_existing(const TeamKeysRequest& request) {
  for (const std::string& drone : request.drones) {
    if (fs::exists(request.folder / drone) || fs::exists(issued_certificate(request.folder, drone)))
      fail(request.folder / drone, "has keys already: revoke them first (--revoke " + drone + ")");
  }
}

void refuse_unknown(const TeamKeysRequest& request) {
  const std::vector<std::string> known = drones_of(request.folder);
  for (const std::string& drone : request.drones) {
    if (std::find(known.begin(), known.end(), drone) == known.end())
      fail(request.folder,
           "no keys of " + drone + " to revoke (there are: " + join(known, ", ") + ")");
  }
}

void forget_drone(const fs::path& team_folder, const std::string& drone) {
  fs::remove_all(team_folder / drone);
  fs::remove(issued_certificate(team_folder, drone));
}

}  // namespace

void make_team_keys(const TeamKeysRequest& request, const std::string& team,
                    const DomainRange& domains, bool replace) {
  check_names(request.drones);
  check_names({team});
  const TeamAuthority authority = make_authority(team, domains, valid_for(kAuthorityDays));
  StagedFolder folder(request.folder, replace ? is_key_folder : nullptr);
  make_private_folder(folder.path());
  write_authority(folder.path() / kAuthorityFolder, authority);
  for (const std::string& drone : request.drones)
    add_drone(folder.path(), authority, drone, request.days);
  folder.commit();
}

void add_team_keys(const TeamKeysRequest& request) {
  check_names(request.drones);
  const TeamAuthority authority = read_authority(request.folder);
  refuse_existing(request);
  for (const std::string& drone : request.drones)
    add_drone(request.folder, authority, drone, request.days);
}

// The others are told before anything is forgotten: who is interrupted can say it again.
void revoke_team_keys(const TeamKeysRequest& request) {
  check_names(request.drones);
  TeamAuthority authority = read_authority(request.folder);
  refuse_unknown(request);
  for (const std::string& drone : request.drones)
    authority.revoked =
        revoke(authority, content_of(issued_certificate(request.folder, drone)), yesterday());
  write_private_file(request.folder / kAuthorityFolder / kRevokedFile, authority.revoked);
  for (const std::string& drone : drones_of(request.folder))
    if (fs::exists(request.folder / drone))
      write_private_file(request.folder / drone / kRevokedFile, authority.revoked);
  for (const std::string& drone : request.drones) forget_drone(request.folder, drone);
}

}  // namespace covey
