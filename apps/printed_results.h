// SPDX-License-Identifier: Apache-2.0
//
// What Polizzi, Hewitt, Hidalgo-Carrió, Delaune and Scaramuzza, "Data-Efficient Collaborative
// Decentralized Thermal-Inertial Odometry" (2022), print in their tables, to stand beside our
// figures.
#pragma once

namespace covey {

// Absolute trajectory error of one drone with a visual camera, m: alone is xVIO.
struct PrintedError {
  const char* scenario;
  const char* drone;
  double together, together_std;
  double alone, alone_std;
};
inline constexpr PrintedError kPrintedErrors[] = {
    {"castle_parallel", "uav0", 0.4312, 0.2632, 0.6183, 0.4136},
    {"castle_parallel", "uav1", 0.3871, 0.1860, 0.4817, 0.3039},
    {"castle_parallel", "uav2", 0.6108, 0.3730, 0.5169, 0.3153},
    {"castle_around", "uav0", 0.3437, 0.1678, 0.3788, 0.1973},
    {"castle_around", "uav1", 0.3663, 0.1531, 0.7186, 0.3547},
    {"castle_around", "uav2", 0.5670, 0.2851, 0.5995, 0.3276},
    {"castle_around", "uav3", 0.8717, 0.4094, 0.7240, 0.3524},
};

struct PrintedRmse {
  double rmse, std;  // m
};

// The same with a thermal camera, whose images are raw or calibrated: alone on raw ones is xVIO.
struct PrintedThermalError {
  const char* scenario;
  const char* drone;
  PrintedRmse alone_raw, alone_calibrated, together_raw, together_calibrated;
};
inline constexpr PrintedThermalError kPrintedThermalErrors[] = {
    {"mars_yard", "uav0", {0.1835, 0.0926}, {0.1906, 0.0882}, {0.1860, 0.0928}, {0.1610, 0.0731}},
    {"mars_yard", "uav1", {0.0813, 0.0382}, {0.0621, 0.0248}, {0.0812, 0.0381}, {0.0438, 0.0189}},
};

// Data of the whole team, MB. The paper writes kB; messages of 190.7 kB at 30 Hz make it MB.
struct PrintedData {
  const char* scenario;
  double naive, messages, requests;
};
inline constexpr PrintedData kPrintedData[] = {
    {"castle_parallel", 152.56, 141.12, 1.64},
    {"castle_around", 639.60, 264.30, 6.89},
    {"mars_yard", 234.37, 22.88, 2.51},
};
inline constexpr double kPrintedMessageKilobytes = 190.7, kPrintedRequestKilobytes = 2.05;

// One drone around the castle.
struct PrintedLoad {
  const char* drone;
  int messages;
  double max_cpu_percent, max_memory_mib;
};
inline constexpr PrintedLoad kPrintedLoads[] = {
    {"uav0", 1482, 165.66, 133.9},
    {"uav1", 1414, 158.56, 124.8},
    {"uav2", 1475, 154.18, 139.1},
    {"uav3", 1465, 170.79, 136.2},
};

}  // namespace covey
