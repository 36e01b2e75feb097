// SPDX-License-Identifier: Apache-2.0
#include "apps/flight_findings.h"

#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "estimator/initializer.h"
#include "frontend/collaborator.h"

namespace covey {
namespace {

nlohmann::json numbers(const Eigen::VectorXd& v) {
  return std::vector<double>(v.data(), v.data() + v.size());
}

nlohmann::json calibration_json(const FoundCalibration& found) {
  const CameraIntrinsics& camera = found.camera;
  const Eigen::Vector4d focal(camera.fx, camera.fy, camera.fx, camera.fy);
  constexpr double kDegrees = 180 / M_PI;
  return {{"time_offset_s", found.extrinsics.time_offset_s},
          {"time_offset_sigma_s", found.sigma.time_offset_s},
          {"p_imu_cam_m", numbers(found.extrinsics.p_imu_cam)},
          {"p_imu_cam_sigma_m", numbers(found.sigma.p_imu_cam)},
          {"q_imu_cam_xyzw", numbers(found.extrinsics.q_imu_cam.coeffs())},
          {"q_imu_cam_sigma_deg", numbers(kDegrees * found.sigma.theta_imu_cam)},
          {"intrinsics_px", {camera.fx, camera.fy, camera.cx, camera.cy}},
          {"intrinsics_sigma_px", numbers(focal.cwiseProduct(found.sigma.intrinsics.head<4>()))},
          {"distortion", found.camera.distortion},
          {"k1_k2_sigma", numbers(found.sigma.intrinsics.tail<2>())}};
}

}  // namespace

nlohmann::json level_frame_json(const Eigen::Isometry3d& frame) {
  const Eigen::Vector3d& p = frame.translation();
  const double yaw = heading_of(Eigen::Quaterniond(frame.linear()));
  return {{"position_m", {p.x(), p.y(), p.z()}}, {"yaw_deg", yaw * 180 / M_PI}};
}

nlohmann::json peer_worlds_json(const DriftFilter& team) {
  nlohmann::json json = nlohmann::json::object();
  for (const std::string& peer : team.peers()) {
    const auto alignment = team.alignment_at_start(peer);
    if (!alignment) continue;
    nlohmann::json& entry = json[peer] = level_frame_json(alignment->T_own_peer);
    const Eigen::Vector3d& at = alignment->p_peer;
    entry["at_m"] = {at.x(), at.y(), at.z()};
    entry["position_sigma_m"] = alignment->position_sigma;
    entry["yaw_sigma_deg"] = alignment->yaw_sigma * 180 / M_PI;
  }
  return json;
}

nlohmann::json camera_json(const Pipeline& pipeline) {
  nlohmann::json json = calibration_json(pipeline.found_calibration());
  json["line_delay_found_s"] = nullptr;
  if (const auto found_s = pipeline.line_delay_found_s()) json["line_delay_found_s"] = *found_s;
  json["at_start"] = calibration_json(pipeline.calibration_at_start());
  return json;
}

nlohmann::json exchange_json(const Pipeline& pipeline, const LinkStatistics& statistics,
                             std::int64_t learned) {
  nlohmann::json json;
  json["rejected_by_link"] = statistics.rejected;
  json["refused_by_link"] = statistics.refused;
  json["dropped_by_load"] = statistics.dropped;
  json["inbox_dropped"] = statistics.inbox_dropped;
  json["landmarks"] = {{"fused", pipeline.peer_landmarks().used},
                       {"gated", pipeline.peer_landmarks().gated},
                       {"unknown_track", pipeline.peer_landmarks().unknown_track},
                       {"invalid", pipeline.peer_landmarks().invalid},
                       {"uninformative", pipeline.peer_landmarks().uninformative}};
  const CollaboratorReport report = pipeline.collaboration().value_or(CollaboratorReport());
  json["requests"] = {{"received", report.adverts_received},
                      {"answered", report.answered},
                      {"unexpected", pipeline.unexpected_questions()},
                      {"malformed", report.advert_malformed},
                      {"other_vocabulary", report.advert_other_vocabulary},
                      {"unknown_asker", report.advert_unknown_asker},
                      {"unknown_place", report.advert_unknown_place},
                      {"too_soon", report.advert_too_soon}};
  json["messages"] = {{"received", report.keyframes_received},
                      {"matched", report.matched},
                      {"landmark_pairs", report.landmark_pairs},
                      {"learned_from", learned}};
  for (std::size_t i = 0; i < kNoMatchReasons; ++i) {
    json["messages"]["no_match"][to_string(static_cast<NoMatchReason>(i))] = report.no_match[i];
  }
  return json;
}

}  // namespace covey
