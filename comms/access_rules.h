// SPDX-License-Identifier: Apache-2.0
//
// Who may say and hear what in a secured team: governance and permissions as XML (DDS Security 1.1,
// 9.4.1.2 and 9.4.1.3), before they are signed. The topics are those of peer_link.h.
//
//   Nobody takes part without the team's certificate and permissions. Each sample is encrypted and
//   authenticated with its writer's key (AES-GCM), and that key is given only to who may read the
//   topic. Protecting submessages instead would save nothing: Fast DDS 2.9.1 decrypts those that
//   are protected, but takes those that are not as well, whoever sent them; only of a protected
//   sample it insists on the writer's key.
#pragma once

#include <chrono>
#include <string>

#include "comms/certificate.h"

namespace covey {

struct DomainRange {
  int first = 0;
  int last = 200;  // as far as link.domain goes
};

struct Validity {
  std::chrono::system_clock::time_point from, until;
};

[[nodiscard]] std::string governance_xml(const std::string& team, const DomainRange& domains);

// A drone asks all and answers anybody of its team, and hears what is meant for all or for itself.
[[nodiscard]] std::string permissions_xml(const Subject& drone, const DomainRange& domains,
                                          const Validity& validity);

}  // namespace covey
