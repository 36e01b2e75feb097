// SPDX-License-Identifier: Apache-2.0
//
// Who says which drones belong to a team: makes the files by which DDS Security knows them
// (key_folder.h), as values; apps/team_keys.h keeps them on disk.
//
//   Two authorities, identity and permissions. With one alone a drone could sign permissions of its
//   own: its certificate would lead to the authority that permissions are trusted by.
//   Elliptic curve P-256 and SHA-256 throughout.
#pragma once

#include <map>
#include <string>

#include "comms/access_rules.h"

namespace covey {

struct Authority {
  std::string key, certificate;  // PEM
};

struct TeamAuthority {
  std::string team;
  DomainRange domains;
  Authority identity, permissions;
  std::string revoked;  // PEM: signed by `identity`
};

// Throw std::runtime_error with what OpenSSL says. Names as in peer_link.h.
[[nodiscard]] TeamAuthority make_authority(const std::string& team, const DomainRange& domains,
                                           const Validity& validity);

// Content by the file names of key_folder.h: all that a drone needs.
using KeyFiles = std::map<std::string, std::string>;
[[nodiscard]] KeyFiles make_keys(const TeamAuthority& authority, const std::string& drone,
                                 const Validity& validity);

// authority.revoked, and this certificate as well.
[[nodiscard]] std::string revoke(const TeamAuthority& authority, const std::string& certificate_pem,
                                 std::chrono::system_clock::time_point now);

}  // namespace covey
