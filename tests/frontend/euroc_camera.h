// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "frontend/camera.h"

namespace covey::testing {

// cam0 of EuRoC (Burri et al., IJRR 2016).
inline CameraIntrinsics euroc_camera() {
  CameraIntrinsics camera;
  camera.width = 752;
  camera.height = 480;
  camera.fx = 458.654;
  camera.fy = 457.296;
  camera.cx = 367.215;
  camera.cy = 248.375;
  camera.distortion = {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05};
  return camera;
}

}  // namespace covey::testing
