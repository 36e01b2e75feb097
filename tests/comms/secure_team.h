// SPDX-License-Identifier: Apache-2.0
//
// A team with keys, in a folder of its own.
#pragma once

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "comms/key_folder.h"
#include "comms/team_authority.h"
#include "tests/apps/temporary_folder.h"
#include "tests/comms/team_config.h"

namespace covey {

inline Validity valid_today() {
  const auto now = std::chrono::system_clock::now();
  return {now - std::chrono::hours(1), now + std::chrono::hours(24)};
}

class SecureTeam {
 public:
  explicit SecureTeam(const std::vector<std::string>& drones)
      : authority_(make_authority(team_config("any").team, DomainRange(), valid_today())) {
    for (const std::string& drone : drones) add(drone, valid_today());
  }

  void add(const std::string& drone, const Validity& validity) {
    for (const auto& [name, content] : make_keys(authority_, drone, validity))
      write(drone, name, content);
  }

  // The file of a drone; nobody but its owner may read it.
  void write(const std::string& drone, const std::string& name, const std::string& content) const {
    const auto file = folder_.write(std::filesystem::path(drone) / name, content);
    std::filesystem::permissions(file, std::filesystem::perms::owner_all);
  }

  // The list by which the others know it.
  [[nodiscard]] std::string revoke(const std::string& drone) const {
    return covey::revoke(authority_, content(drone, kCertificateFile),
                         std::chrono::system_clock::now() - std::chrono::minutes(1));
  }

  [[nodiscard]] LinkConfig config(const std::string& drone) const {
    LinkConfig out = team_config(drone);
    out.security = folder_.path().string();
    out.profile = lossless_profile();  // a busy machine shall not cost a question
    out.profile.security.required = true;
    out.profile.transport.datagram_bytes = 8000;  // as the profile `secure`
    return out;
  }

  [[nodiscard]] const TeamAuthority& authority() const { return authority_; }
  [[nodiscard]] std::filesystem::path file(const std::string& drone, const char* name) const {
    return folder_.path() / drone / name;
  }
  [[nodiscard]] std::string content(const std::string& drone, const char* name) const {
    std::ifstream stream(file(drone, name), std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }

 private:
  TeamAuthority authority_;
  TemporaryFolder folder_;
};

}  // namespace covey
