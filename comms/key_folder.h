// SPDX-License-Identifier: Apache-2.0
//
// The files by which a drone shows who it is, knows its team and proves what it may say, in a
// folder of its own below LinkConfig::security: <security>/<agent>/. `covey keys` makes them.
#pragma once

#include <filesystem>

#include "comms/peer_link.h"

namespace covey {

inline constexpr char kPrivateKeyFile[] = "key.pem";  // nobody else may read it
inline constexpr char kCertificateFile[] = "certificate.pem";
inline constexpr char kIdentityAuthorityFile[] = "identity_authority.pem";
inline constexpr char kPermissionsAuthorityFile[] = "permissions_authority.pem";
inline constexpr char kRevokedFile[] =
    "revoked.pem";  // certificates that are not believed any more
inline constexpr char kGovernanceFile[] = "governance.p7s";
inline constexpr char kPermissionsFile[] = "permissions.p7s";

[[nodiscard]] std::filesystem::path key_folder(const LinkConfig& config);

// Whether DDS will accept them, with a clearer word than DDS has: throws std::runtime_error that
// names the file and what to do.
void check_keys(const LinkConfig& config);

}  // namespace covey
