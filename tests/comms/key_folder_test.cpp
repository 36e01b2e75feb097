// SPDX-License-Identifier: Apache-2.0
#include "comms/key_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <stdexcept>

#include "comms/certificate.h"
#include "tests/comms/secure_team.h"

namespace covey {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

std::string complaint_about(const LinkConfig& config) {
  try {
    const PeerLink link(config);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "no complaint";
}

// Of uav0's link, after something was done to the team's keys or to its settings.
std::string complaint(const std::function<void(SecureTeam&, LinkConfig&)>& damage) {
  SecureTeam team({"uav0", "uav1"});
  LinkConfig config = team.config("uav0");
  damage(team, config);
  return complaint_about(config);
}

TEST(KeyFolder, EachMissingFileIsNamedWithTheCommandThatMakesIt) {
  const SecureTeam team({"uav0"});
  for (const char* name :
       {kPrivateKeyFile, kCertificateFile, kIdentityAuthorityFile, kPermissionsAuthorityFile,
        kRevokedFile, kGovernanceFile, kPermissionsFile}) {
    const std::string content = team.content("uav0", name);
    std::filesystem::remove(team.file("uav0", name));
    EXPECT_THAT(complaint_about(team.config("uav0")),
                AllOf(HasSubstr(team.file("uav0", name).string() + " cannot be read"),
                      HasSubstr("covey keys --out"), HasSubstr("--add uav0")));
    team.write("uav0", name, content);
  }
}

TEST(KeyFolder, EachDamagedFileIsNamed) {
  const SecureTeam team({"uav0"});
  for (const char* name :
       {kPrivateKeyFile, kCertificateFile, kIdentityAuthorityFile, kPermissionsAuthorityFile,
        kRevokedFile, kGovernanceFile, kPermissionsFile}) {
    const std::string content = team.content("uav0", name);
    team.write("uav0", name, content.substr(0, content.size() / 2));
    EXPECT_THAT(complaint_about(team.config("uav0")), HasSubstr(team.file("uav0", name).string()));
    team.write("uav0", name, content);
  }
}

TEST(KeyFolder, AProfileThatRequiresKeysIsNeverFlownWithout) {
  EXPECT_THAT(complaint([](auto&, auto& config) { config.security = ""; }),
              AllOf(HasSubstr("the profile requires keys"), HasSubstr("covey keys --team")));
}

TEST(KeyFolder, AKeyThatOthersCanReadIsRefused) {
  EXPECT_THAT(complaint([](auto& team, auto&) {
                std::filesystem::permissions(team.file("uav0", kPrivateKeyFile),
                                             std::filesystem::perms::group_read,
                                             std::filesystem::perm_options::add);
              }),
              AllOf(HasSubstr("key.pem can be read by others"), HasSubstr("chmod 600")));
}

TEST(KeyFolder, AnotherDronesOrTeamsKeysAreRefused) {
  EXPECT_THAT(complaint([](auto& team, auto&) {
                team.write("uav0", kCertificateFile, team.content("uav1", kCertificateFile));
              }),
              HasSubstr("is that of uav1 in team"));
  EXPECT_THAT(complaint([](auto&, auto& config) { config.team = "red"; }),
              HasSubstr("but this is uav0 in team red"));
  EXPECT_THAT(complaint([](auto& team, auto&) {
                team.write("uav0", kPrivateKeyFile, team.content("uav1", kPrivateKeyFile));
              }),
              HasSubstr("certificate.pem does not belong to key.pem"));
}

TEST(KeyFolder, PermissionsOfOthersOrByOthersAreRefused) {
  EXPECT_THAT(complaint([](auto& team, auto&) {
                team.write("uav0", kPermissionsFile, team.content("uav1", kPermissionsFile));
              }),
              HasSubstr("permissions.p7s does not grant CN=uav0,O="));
  EXPECT_THAT(complaint([](auto& team, auto&) {
                const SecureTeam other({"uav0"});
                team.write("uav0", kGovernanceFile, other.content("uav0", kGovernanceFile));
              }),
              HasSubstr("governance.p7s was not signed by the team's authority"));
}

// Its certificate leads to the identity authority, which says nothing about permissions.
TEST(KeyFolder, ADroneCannotSignPermissionsOfItsOwn) {
  SecureTeam team({"uav0"});
  const auto key = private_key_from(team.content("uav0", kPrivateKeyFile));
  const auto certificate = certificate_from(team.content("uav0", kCertificateFile));
  const auto authority = certificate_from(team.authority().permissions.certificate);
  const auto identity = certificate_from(team.authority().identity.certificate);
  const std::string own = sign("all is allowed", *certificate, *key);
  EXPECT_EQ(verified_text(own, *authority), std::nullopt);
  EXPECT_NE(verified_text(own, *identity), std::nullopt);
}

TEST(KeyFolder, OldAndRevokedCertificatesAreRefused) {
  EXPECT_THAT(complaint([](auto& team, auto&) {
                const auto now = std::chrono::system_clock::now();
                team.add("uav0", {now - std::chrono::hours(48), now - std::chrono::hours(1)});
              }),
              HasSubstr("certificate.pem is not valid, certificate has expired"));
  EXPECT_THAT(
      complaint([](auto& team, auto&) { team.write("uav0", kRevokedFile, team.revoke("uav0")); }),
      HasSubstr("certificate.pem is not valid, certificate revoked"));
}

TEST(KeyFolder, DatagramsThatHoldNoHandshakeAreRefused) {
  EXPECT_THAT(
      complaint([](auto&, auto& config) { config.profile.transport.datagram_bytes = 1400; }),
      AllOf(HasSubstr("datagram_bytes of the profile is 1400"),
            HasSubstr("choose the profile secure")));
}

TEST(AccessRules, ADroneHearsWhatIsMeantForAllOrForItself) {
  const std::string xml = permissions_xml({"blue", "uav0"}, DomainRange(), valid_today());
  const std::string reads = xml.substr(xml.find("<subscribe>"));
  EXPECT_THAT(reads, AllOf(HasSubstr(">covey/blue/request<"), HasSubstr(">covey/blue/status<"),
                           HasSubstr(">covey/blue/message/uav0<"), Not(HasSubstr("message/*"))));
}

}  // namespace
}  // namespace covey
