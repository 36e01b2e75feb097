// SPDX-License-Identifier: Apache-2.0
#include "comms/link_network.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace covey {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

const OwnAddress kLo{"127.0.0.1", true}, kRadio{"10.0.0.2", true}, kDeadRadio{"10.0.0.2", false},
    kCable{"192.168.1.2", true};

LinkConfig config_on(const std::vector<std::string>& interfaces) {
  LinkConfig config;
  config.loopback_only = false;
  config.interfaces = interfaces;
  return config;
}

TEST(LinkNetwork, ANamedInterfaceIsUsableOnceItHasACarrier) {
  const LinkConfig config = config_on({"10.0.0.2"});
  const LinkNetwork dead = link_network(config, {kLo, kDeadRadio, kCable});
  EXPECT_THAT(dead.usable, IsEmpty());
  EXPECT_EQ(dead.missing, "link.interfaces \"10.0.0.2\" has no carrier");
  EXPECT_FALSE(on_what_is_there(config, dead));
  const LinkNetwork alive = link_network(config, {kLo, kRadio, kCable});
  EXPECT_THAT(alive.usable, ElementsAre("10.0.0.2"));
  EXPECT_EQ(alive.missing, "");
  EXPECT_THAT(on_what_is_there(config, alive)->interfaces, ElementsAre("10.0.0.2"));
}

TEST(LinkNetwork, OfSeveralThoseAreUsedThatAreThere) {
  const LinkConfig config = config_on({"10.0.0.2", "192.168.1.2", "10.1.0.1"});
  const LinkNetwork network = link_network(config, {kLo, kDeadRadio, kCable});
  EXPECT_EQ(network.missing,
            "link.interfaces \"10.0.0.2\" has no carrier, link.interfaces \"10.1.0.1\" is no "
            "address of this computer now");
  EXPECT_THAT(on_what_is_there(config, network)->interfaces, ElementsAre("192.168.1.2"));
}

TEST(LinkNetwork, WhoNamesNoneUsesAllButTheLoopbackAndMissesAny) {
  const LinkConfig config = config_on({});
  const LinkNetwork none = link_network(config, {kLo, kDeadRadio});
  EXPECT_THAT(none.usable, IsEmpty());
  EXPECT_EQ(none.missing, "no interface has an address and a carrier");
  EXPECT_TRUE(on_what_is_there(config, none)) << "drones of one computer find each other";
  const LinkNetwork some = link_network(config, {kLo, kRadio, kCable});
  EXPECT_THAT(some.usable, ElementsAre("10.0.0.2", "192.168.1.2"));
  EXPECT_EQ(some.missing, "");
}

TEST(LinkNetwork, AnAddressThatComesIsWorthANewLinkAndOneThatGoesIsNot) {
  const LinkConfig all = config_on({}), named = config_on({"10.0.0.2"});
  const std::vector<OwnAddress> before = {kLo, kCable}, after = {kLo, kCable, kRadio};
  EXPECT_TRUE(uses_too_little(link_network(all, before).usable, link_network(all, after)));
  EXPECT_TRUE(uses_too_little(link_network(all, {kLo}).usable, link_network(all, before)));
  EXPECT_FALSE(uses_too_little(link_network(all, after).usable, link_network(all, before)));
  EXPECT_FALSE(uses_too_little(link_network(all, after).usable, link_network(all, after)));
  EXPECT_TRUE(uses_too_little(link_network(named, before).usable, link_network(named, after)));
  EXPECT_FALSE(uses_too_little(link_network(named, {kRadio}).usable, link_network(named, after)));
  const LinkConfig loopback;
  EXPECT_FALSE(uses_too_little(link_network(loopback, {}).usable, link_network(loopback, after)));
}

TEST(LinkNetwork, TheLoopbackIsAlwaysThere) {
  const LinkNetwork network = link_network(LinkConfig(), {});
  EXPECT_THAT(network.usable, ElementsAre("127.0.0.1"));
  EXPECT_EQ(network.missing, "");
  EXPECT_TRUE(on_what_is_there(LinkConfig(), network));
}

}  // namespace
}  // namespace covey
