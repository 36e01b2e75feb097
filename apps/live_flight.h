// SPDX-License-Identifier: Apache-2.0
//
// A drone in the air: its own camera and IMU over DDS (comms/onboard_link.h) instead of a
// recording.
#pragma once

#include "apps/config_file.h"

namespace covey {

// Flies until it is stopped or agent.duration_s is over; waits for nobody. Sensors that are silent
// or say what cannot be flown are warned of, and flown as soon as they speak sense. Returns false
// if it was stopped before agent.duration_s was over. Throws std::runtime_error for settings and
// files that cannot be flown with, and if it has not started when agent.duration_s is over.
bool run_live_agent(const AgentConfig& config);

}  // namespace covey
