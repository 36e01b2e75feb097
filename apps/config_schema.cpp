// SPDX-License-Identifier: Apache-2.0
//
// The keys of the configuration: name, place in the program, range, meaning and unit.
#include "apps/config_file.h"

namespace covey {
namespace {

constexpr double kManyTimes = 1e6;

void visit_agent(AgentSettings& agent, ConfigVisitor& v) {
  v.text("name", agent.name, "unique in the team");
  v.text("dataset", agent.dataset,
         "folder that holds cam0 and imu0; their sensor.yaml is all that pace 'live' wants");
  v.text("out", agent.out, "folder for the drone's files");
  v.text("vocabulary", agent.vocabulary,
         "words of places: visual, thermal or a file; empty: what suits the camera");
  v.option("mode", agent.mode, {"collaborative", "solo"}, "solo: no link at all");
  v.option("pace", agent.pace, {"max", "lockstep", "rate", "live"},
           "a recording as fast as possible, as a team says, or by the clock; or what section "
           "onboard hears");
  v.number("real_time_factor", agent.real_time_factor, {0.01, 100}, "of pace 'rate'");
  v.count("image_queue", agent.image_queue, {1, 1000},
          "images that wait at pace 'rate' or 'live'; then the oldest is dropped");
  v.number("duration_s", agent.duration_s, {0, kManyTimes},
           "[s] to fly; 0: all of the recording, or until stopped");
  v.count("wait_for_peers", agent.wait_for_peers, {0, kMaxAgents - 1},
          "drones to be in touch with at start; pace 'live' waits for nobody");
  v.number("peer_timeout_s", agent.peer_timeout_s, {0, kManyTimes},
           "[s] then the drone flies without them");
}

void visit_initialisation(InitialisationConfig& start, ConfigVisitor& v) {
  v.option("method", start.method, {"static", "groundtruth"},
           "gravity from standing still, or pose and velocity from ground truth");
  v.number("position_sigma_m", start.position_sigma, {1e-9, 1e3}, "[m] standard deviation");
  v.angle("yaw_sigma_deg", start.yaw_sigma, {1e-6, 180},
          "[deg] standard deviation, in the world that the drones share");
  v.angle("tilt_sigma_deg", start.tilt_sigma, {1e-6, 45},
          "[deg] standard deviation, of a start from ground truth against gravity");
  v.number("velocity_sigma", start.velocity_sigma, {1e-9, 100}, "[m/s] standard deviation");
  v.number("gyro_bias_sigma", start.gyro_bias_sigma, {1e-9, 1}, "[rad/s] standard deviation");
  v.number("accel_bias_sigma", start.accel_bias_sigma, {1e-9, 10}, "[m/s2] standard deviation");
  v.number("x_m", start.p_world_imu.x(), {-1e6, 1e6}, "[m] static start without ground truth");
  v.number("y_m", start.p_world_imu.y(), {-1e6, 1e6}, "[m] static start without ground truth");
  v.number("z_m", start.p_world_imu.z(), {-1e6, 1e6}, "[m] static start without ground truth");
  v.angle("yaw_deg", start.yaw, {-360, 360},
          "[deg] static start without ground truth: heading of the IMU's x axis, or of its z axis "
          "where x points up or down");
  v.flag("own_world", start.own_world,
         "start at the origin of a world of the own; see fusion.common_start");
}

void visit_thermal(ThermalConfig& thermal, ConfigVisitor& v) {
  v.option("mode", thermal.mode, {"auto", "raw", "calibrated"},
           "photometric calibration; auto: for thermal cameras, known by sensor.yaml or 16 bits; "
           "calibrated: the camera is a thermal one, whatever those say");
  v.number("time_constant_s", thermal.time_constant_s, {0, 0.1},
           "[s] by which thermal images lag their stamps, unless sensor.yaml says; 0: not at all");
  v.number("pixel_lag_s", thermal.pixel_lag.time_constant_s, {0, 0.05},
           "[s] time constant of the pixels, which smear what moves; 0: they do not");
  v.number("pixel_lag_sigma_s", thermal.pixel_lag.sigma_s, {0, 0.05},
           "[s] standard deviation; the lag is estimated while flying, 0: it is known");
  v.number(
      "pixel_lag_shift_sigma_px", thermal.pixel_lag.shift_sigma_px, {1e-3, 1e3},
      "[px] of a patch in the image of half the size, errors that last and are shared included");
  v.number("pixel_lag_wander", thermal.pixel_lag.wander, {0, 1}, "[s/sqrt(s)] of the estimate");
  v.number("aligned_scale", thermal.aligned_scale, {0, 1000},
           "as tracker.aligned_scale, for thermal cameras");
  v.number("imu_noise_scale", thermal.imu_noise_scale, {1e-3, 1e3},
           "as estimator.imu_noise_scale, for thermal cameras");
}

void visit_temporal(ThermalConfig& thermal, ConfigVisitor& v) {
  PhotometricConfig& p = thermal.photometric;
  v.flag("temporal", p.temporal, "estimate gain and offset of each image");
  v.count("window", p.gain.window, {1, 100}, "past images an image is compared with");
  v.count("window_spacing", p.gain.spacing, {1, 100}, "images between two of them");
  v.count("patch_radius_px", p.gain.patch_radius_px, {1, 50},
          "[px] of the warped patch whose mean is compared");
  v.count("min_shared_tracks", p.gain.min_tracks, {3, 1000}, "of two images that are compared");
  v.count("fit_iterations", p.gain.iterations, {1, 100}, "of reweighting at most");
  v.number("relaxation_s", p.gain.relaxation_s, {1, kManyTimes},
           "[s] time constant of the pull towards the first image's mean and spread");
  v.number("gain_sigma", p.gain.link_sigma, {1e-4, 1}, "of the gain that tracks tell, relative");
  v.flag("pattern", p.pattern, "take the gain from how strongly the sensor's pattern shows");
  v.number("pattern_travel_px", p.pattern_gain.travel_px, {1, 1e4},
           "[px] that the scene moves between two looks at the pattern");
  v.count("pattern_memory", p.pattern_gain.memory, {1, 1e6}, "looks of each half that count");
  v.number("pattern_gain_sigma", p.pattern_gain.trusted_sigma, {1e-4, 1},
           "relative, of the least certain gain that the pattern may tell");
  v.count("pattern_fewest_looks", p.pattern_gain.fewest_looks, {2, 1e6},
          "of both halves, before the pattern is known");
  v.number("pattern_edge", p.pattern_gain.edge, {1, 1e3},
           "steps between pixels that are larger are the scene's, of the mean step");
  v.number("pattern_contradiction_sigmas", p.gain.contradiction_sigmas, {1, 1e3},
           "standard deviations, from which on tracks deny the pattern's gain");
  v.count("pattern_contradictions", p.pattern_gain.contradictions, {1, 1e6},
          "images in a row in which tracks deny it: the pattern is another one");
}

void visit_spatial(ThermalConfig& thermal, ConfigVisitor& v) {
  PhotometricConfig& p = thermal.photometric;
  v.flag("spatial", p.spatial, "estimate the additive field");
  v.count("field_cells_across", p.field.cells_across, {4, 200}, "between nodes of the field");
  v.number("field_length_cells", p.field.length_cells, {0.5, 100}, "[cells] correlation length");
  v.number("field_sigma", p.field.sigma, {1e-3, 100},
           "standard deviation of the field, of that of the image");
  v.number("field_corrected_share", p.field.corrected_share, {1e-2, 1},
           "of that deviation, left after a shutter event");
  v.number("field_wander_s", p.field.wander_s, {0.1, kManyTimes}, "[s] until it is another");
  v.number("field_refresh_s", p.field.refresh_s, {0.01, 1e3}, "[s] between two sights");
  v.number("field_least_eigenvalue", p.field.least_eigenvalue, {1e-6, 0.5},
           "of the largest; weaker modes are left out");
  v.number("field_soft_sigmas", p.field.soft_sigmas, {0.1, 1e3},
           "standard deviations, from which on a difference counts less");
  v.count("block_fewest_tracks", p.block.fewest_tracks, {6, 1000}, "of two sights compared");
  v.count("block_iterations", p.block.iterations, {0, 100}, "of aligning a block");
  v.number("block_near_px", p.block.near_px, {0.1, 1e4},
           "[px] a nearer track tells a block's flow no better");
  v.number("block_far_px", p.block.far_px, {0.1, 1e4}, "[px] a farther one hardly");
  v.number("block_farthest_squares", p.block.farthest_squares, {0.1, 100},
           "[squares] from where the flow says, where a block is given up");
  v.number("block_flow_sigma_px", p.block.flow_sigma_px, {1e-2, 100},
           "[px] of the place that tracks predict for a block");
  v.number("block_pixel_noise", p.block.pixel_noise, {1e-4, 100},
           "of 4x4 px, of the image's standard deviation");
  v.number("block_level_noise", p.block.level_noise, {1e-4, 100},
           "of a block's mean, of the image's standard deviation");
  v.number("block_misfit_noise", p.block.misfit_noise, {0, 100},
           "of a block's mean, of what is left of its texture");
}

void visit_stripes(ThermalConfig& thermal, ConfigVisitor& v) {
  PhotometricConfig& p = thermal.photometric;
  v.flag("stripes", p.stripes, "estimate what each column and row reads too much or too little");
  v.number("stripe_travel_px", p.stripe.travel_px, {1, 1e4},
           "[px] that the scene moves between two looks");
  v.count("stripe_window_px", p.stripe.window_px, {3, 1000},
          "[px] columns or rows whose mean is the scene's");
  v.number("stripe_edge", p.stripe.edge, {0.1, 1e3},
           "steps between pixels that are larger are the scene's, of the mean step");
  v.count("stripe_memory", p.stripe.memory, {1, 1e6}, "looks that count");
  v.count("stripe_kept", p.stripe.kept, {1, 1e6}, "of them after a shutter event, at most");
  v.count("stripe_trial", p.stripe.trial, {0, 1e6}, "looks after which stripes are half believed");
}

void visit_image_defects(ThermalConfig& thermal, ConfigVisitor& v) {
  PhotometricConfig& p = thermal.photometric;
  v.number("repeated_share", p.shutter.repeated_share, {0.5, 1},
           "of pixels unchanged in an image that was repeated: it is passed over");
  v.number("frozen_s", p.shutter.frozen_s, {0, 1e3},
           "[s] without another image, from which on the shutter is closed");
  v.number("uniform_noises", p.shutter.uniform_noises, {0, 1e3},
           "standard deviations of noise over which a scene spreads at least");
  v.number("uniform_range", p.shutter.uniform_range, {0, 65535},
           "[grey levels] and at least so far");
  v.number("bad_pixel_deviations", p.bad_pixels.deviations, {3, 1e3},
           "from its neighbours' median, of what is typical");
  v.number("bad_pixel_interval_s", p.bad_pixels.interval_s, {0.01, 1e3}, "[s] between two checks");
  v.number("bad_pixel_travel_px", p.bad_pixels.travel_px, {0, 1e3},
           "[px] that the scene moves between two checks");
  v.count("bad_pixel_checks", p.bad_pixels.checks, {1, 100}, "in a row");
  v.number("bad_pixel_most_share", p.bad_pixels.most_share, {0, 1},
           "of the pixels; where more stand out none is replaced");
  v.number("cut_off_share", p.cut_off_share, {1e-5, 1},
           "of the pixels that have the same largest value: there the sensor is saturated");
  v.number("chain_most_stretch", p.chain.most_stretch, {1.1, 1e3},
           "of the image's spread, against the chain's first, beyond which it begins anew");
  v.number("chain_most_shift", p.chain.most_shift, {0.1, 16},
           "standard deviations of that image, likewise, of the mean");
}

void visit_tone(ThermalConfig& thermal, ConfigVisitor& v) {
  ToneConfig& tone = thermal.photometric.tone;
  v.option("contrast", tone.contrast, {"linear", "equalised"}, "how 8 bits are spread");
  v.number("tone_ignored_share", tone.ignored_share, {0, 0.4},
           "of the darkest and of the brightest pixels");
  v.number("tone_max_slope", tone.max_slope, {1, 100}, "of the equalised curve, over the linear");
  v.number("tone_min_slope", tone.min_slope, {0, 1}, "of the equalised curve, over the linear");
  v.count("tone_margin", tone.margin, {0, 100}, "[grey levels] left free at either end");
  v.number("tone_adapt_s", tone.adapt_s, {0.01, kManyTimes}, "[s] time constant of the curve");
}

void visit_tracker(TrackerConfig& tracker, ConfigVisitor& v) {
  v.count("max_tracks", tracker.max_tracks, {10, 5000}, "per image");
  v.number("pixel_sigma_px", tracker.pixel_sigma, {1e-3, 20},
           "[px] standard deviation of a corner that was just found");
  v.number("aligned_sigma_px", tracker.aligned_sigma, {1e-3, 20},
           "[px] of one that is followed, beside what its alignment claims");
  v.number("aligned_scale", tracker.aligned_scale, {0, 1000},
           "by which errors are larger than an alignment claims");
  v.number("lasting_scale", tracker.lasting_scale, {1, 1000},
           "by how much more where a track is used in every image, since errors last");
  v.count("pyramid_levels", tracker.pyramid_levels, {1, 6}, "the image itself and its halves");
  v.count("predicted_levels", tracker.predicted_levels, {1, 8},
          "of them, tried first for a track whose motion is known");
  v.number("min_correlation", tracker.min_correlation, {-1, 1},
           "of a patch and where it was found");
  v.number("max_scale", tracker.max_scale, {1, 100}, "beyond it a patch is cut anew");
  v.number("duplicate_distance_px", tracker.duplicate_distance, {0, 100},
           "[px] of two tracks nearer than this the younger ends");
  v.number("refill_below", tracker.refill_below, {0, 1},
           "share of max_tracks below which corners are looked for");
}

void visit_alignment(TrackerConfig& tracker, ConfigVisitor& v) {
  v.count("align_max_iterations", tracker.alignment.max_iterations, {1, 1000}, "on each level");
  v.number("align_converged_step_px", tracker.alignment.converged_step, {1e-6, 1}, "[px]");
  v.number("align_coarse_step_px", tracker.alignment.coarse_step, {1e-6, 10},
           "[px] of a coarse level");
  v.number("align_min_texture", tracker.alignment.min_texture, {0, 255},
           "[grey levels/px] in the patch's weakest direction");
  v.number("align_affine_sigma", tracker.alignment.affine_sigma, {1e-6, 10},
           "change of an entry of the affine map from image to image");
  v.number("align_grey_sigma", tracker.alignment.grey_sigma, {1e-6, 255}, "[grey levels]");
}

void visit_corners(TrackerConfig& tracker, ConfigVisitor& v) {
  v.number("corner_min_distance_px", tracker.corners.min_distance, {1, 1000},
           "[px] between two tracks");
  v.count("corner_border_px", tracker.corners.border, {8, 1000}, "[px] of the image's edge");
  v.count("corner_start_threshold", tracker.corners.start_threshold, {1, 255},
          "[grey levels] of FAST");
  v.count("corner_min_threshold", tracker.corners.min_threshold, {1, 255},
          "[grey levels] of FAST in cells of little contrast");
  v.count("corner_max_threshold", tracker.corners.max_threshold, {1, 255},
          "[grey levels] of FAST in cells of much contrast");
  v.number("corner_min_eigenvalue", tracker.corners.min_eigenvalue, {0, 1e6},
           "[(grey levels/px)^2] of the structure tensor");
  v.count("corner_max_per_cell", tracker.corners.max_per_cell, {1, 100},
          "when other cells are empty");
  v.count("corner_cells_per_image", tracker.corners.cells_per_image, {1, 1e5},
          "looked at in one image, except in the first");
}

void visit_outliers(TrackerConfig& tracker, ConfigVisitor& v) {
  v.number("outlier_max_deviations", tracker.outliers.max_deviations, {0.1, 1e3},
           "robust standard deviations from the epipolar line");
  v.number("outlier_min_epipolar_px", tracker.outliers.min_epipolar_px, {0.01, 100},
           "[px] never a narrower band than this");
  v.number("outlier_max_epipolar_px", tracker.outliers.max_epipolar_px, {0.01, 100},
           "[px] never a wider band than this");
  v.number("outlier_parallax_px", tracker.outliers.parallax_px, {0, 1000},
           "[px] images are compared when this far apart");
  v.count("outlier_max_lag", tracker.outliers.max_lag, {2, 15}, "images apart at most");
  v.count("outlier_iterations", tracker.outliers.iterations, {1, 1e5}, "of RANSAC");
  v.count("outlier_min_tracks", tracker.outliers.min_tracks, {0, 1e5},
          "with fewer nothing is rejected");
  v.number("outlier_min_consensus", tracker.outliers.min_consensus, {0, 1},
           "with a smaller share agreeing nothing is rejected");
  v.number("outlier_gyro_sigma", tracker.outliers.gyro_sigma, {0, 10}, "[rad/s]");
}

void visit_estimator(EstimatorConfig& estimator, ConfigVisitor& v) {
  v.number("imu_noise_scale", estimator.imu_noise_scale, {1e-3, 1e3},
           "times the noise densities of sensor.yaml, which are those of a data sheet");
  v.number("gravity", estimator.gravity, {0, 30}, "[m/s2]");
  v.number("max_imu_gap_s", estimator.max_imu_gap_s, {1e-3, 10}, "[s] longer ones are counted");
  v.number("max_gyro", estimator.max_gyro, {0.1, 1e3}, "[rad/s] a sample beyond is refused");
  v.number("max_accel", estimator.max_accel, {10, 1e4}, "[m/s2] a sample beyond is refused");
  v.count("max_clones", estimator.max_clones, {3, 100}, "keyframes kept");
  v.count("max_slam_features", estimator.max_slam_features, {0, 1000}, "landmarks in the state");
  v.count("max_msckf_features", estimator.max_msckf_features, {0, 1000}, "in one update");
  v.number("observation_noise_scale", estimator.observation_noise_scale, {1e-3, 1e3},
           "times the tracker's sigma");
  v.number("gate_confidence", estimator.gate_confidence, {0.5, 0.999999},
           "share of good features that pass the chi-square gate");
}

void visit_features(EstimatorConfig& estimator, ConfigVisitor& v) {
  v.number("keyframe_parallax", estimator.keyframe_parallax, {0, 1},
           "rotation-free motion of the tracks, on the normalised plane");
  v.number("keyframe_max_age_s", estimator.keyframe_max_age_s, {0, 1e3}, "[s]");
  v.number("keyframe_min_shared", estimator.keyframe_min_shared, {0, 1}, "share of tracks");
  v.number("max_msckf_depth_error", estimator.max_msckf_depth_error, {1e-3, 10},
           "of the inverse depth, relative");
  v.number("max_slam_depth_error", estimator.max_slam_depth_error, {1e-3, 10},
           "of the inverse depth, relative");
  v.number("min_depth_m", estimator.min_depth, {1e-3, 1e3}, "[m]");
  v.number("max_depth_m", estimator.max_depth, {1, 1e6}, "[m]");
}

void visit_calibration(EstimatorConfig& estimator, ConfigVisitor& v) {
  v.flag("calibrate_extrinsics", estimator.calibrate_extrinsics, "camera to IMU, while flying");
  v.number("extrinsics_sigma_m", estimator.extrinsics_sigma_m, {0, 10},
           "[m] standard deviation of what the dataset says");
  v.angle("extrinsics_sigma_deg", estimator.extrinsics_sigma_rad, {0, 90},
          "[deg] standard deviation of what the dataset says");
  v.flag("calibrate_time_offset", estimator.calibrate_time_offset, "camera to IMU, while flying");
  v.number("time_offset_sigma_s", estimator.time_offset_sigma_s, {0, 1}, "[s]");
  v.flag("calibrate_intrinsics", estimator.calibrate_intrinsics,
         "focal lengths, principal point, k1 and k2, while flying");
  v.number("focal_length_sigma", estimator.focal_length_sigma, {0, 1},
           "standard deviation of what the dataset says, over the focal length");
  v.number("principal_point_sigma", estimator.principal_point_sigma, {0, 1},
           "standard deviation of what the dataset says, over the focal length");
  v.number("distortion_sigma", estimator.distortion_sigma, {0, 1},
           "standard deviation of what the dataset says of k1 and of k2");
}

void visit_standing_still(EstimatorConfig& estimator, ConfigVisitor& v) {
  v.flag("zero_velocity_updates", estimator.zero_velocity_updates, "when standing still");
  v.number("still_window_s", estimator.still_window_s, {0.01, 10}, "[s]");
  v.number("still_parallax", estimator.still_parallax, {0, 1}, "normalised plane, over the window");
  v.number("still_drift", estimator.still_drift, {0, 1},
           "normalised plane, over two seconds, rotation included");
  v.number("still_gyro", estimator.still_gyro, {0, 10}, "[rad/s] change over the window");
  v.number("still_accel", estimator.still_accel, {0, 100}, "[m/s2] change over the window");
  v.number("still_velocity_sigma", estimator.still_velocity_sigma, {1e-9, 10}, "[m/s]");
  v.number("still_gyro_sigma", estimator.still_gyro_sigma, {1e-9, 10}, "[rad/s]");
  v.number("still_accel_sigma", estimator.still_accel_sigma, {1e-9, 100}, "[m/s2]");
  v.number("lost_after_s", estimator.lost_after_s, {0.01, 1e3}, "[s] with most features gated");
  v.number("max_velocity", estimator.max_velocity, {0.1, 1e3}, "[m/s] beyond it is lost");
}

void visit_collaboration(CollaboratorConfig& c, ConfigVisitor& v) {
  v.option("exchange", c.exchange, {"compact", "paper", "naive"},
           "questions per new view and short answers; the paper's; every image to all");
  v.number("keyframe_baseline_over_depth", c.keyframe.baseline_over_depth, {1e-3, 10},
           "way since the last keyframe over mean depth");
  v.angle("keyframe_rotation_deg", c.keyframe.rotation, {0.1, 180},
          "[deg] since the last keyframe");
  v.number("keyframe_min_interval_s", c.keyframe.min_interval_s, {0, 1e3}, "[s]");
  v.number("question_baseline_over_depth", c.question.baseline_over_depth, {1e-3, 10},
           "way since the last keyframe that was asked about, over mean depth");
  v.angle("question_rotation_deg", c.question.rotation, {0.1, 180}, "[deg] since then");
  v.number("question_min_interval_s", c.question.min_interval_s, {0, 1e3}, "[s] since then");
  v.number(
      "corners_interval_s", c.corners_interval_s, {0, 1e3},
      "[s] between questions that carry corners, four times as long while answers match; those "
      "between ask peers that know the world");
  v.number("repeat_question_s", c.repeat_question_s, {0, 1e3},
           "[s] until one that nobody answers is asked again where nothing new is seen; 0: never");
  v.number("keyframe_fallback_depth_m", c.keyframe.fallback_depth, {0.01, 1e4},
           "[m] while no landmark is known");
  v.number("keyframe_max_relative_sigma", c.keyframe.max_relative_sigma, {1e-3, 10},
           "of landmarks that count in the mean depth");
  v.count("database_capacity", c.database.capacity, {1, 1e5}, "keyframes");
  v.count("database_protected_newest", c.database.protected_newest, {0, 1e5}, "keyframes");
  v.option("place_mode", c.place_mode, {"paper", "majority", "compact"},
           "what a request says of a place: residuals of words OR-ed or voted, or short corners; "
           "of exchange 'compact', the others use paper");
  v.number("place_threshold", c.place_threshold, {0, 1},
           "least score that is answered; 0: what suits the mode");
  v.number("answer_max_difference", c.answer_max_difference, {0, 100},
           "of a keyframe that is answered: way over depth, plus angle in rad, beyond doubt");
  v.number("answer_interval_s", c.limiter.answer_interval_s, {0, 1e3}, "[s] to one peer");
  v.number("resend_interval_s", c.limiter.resend_interval_s, {0, 1e4},
           "[s] same keyframe to one peer, or any to one that finds nothing");
  v.flag("pictures_always", c.pictures_always,
         "landmarks go with pictures in exchanges 'paper' and 'naive' as well; the paper has none");
  v.flag("tell_found", c.tell_found, "who has answered is told what came of it");
  v.count("max_peers", c.limiter.max_peers, {1, 1000}, "that get answers");
  v.number("loop_min_age_s", c.loop_min_age_s, {0, 1e6}, "[s] of an own keyframe to return to");
  v.number("revisit_max_difference", c.revisit_max_difference, {0, 10},
           "of a keyframe that is matched again: way over depth, plus angle in rad");
  v.count("max_revisits", c.max_revisits, {0, 100}, "for one keyframe");
  v.count("min_landmarks", c.min_landmarks, {1, 256}, "in an answer");
  v.number("drift_px", c.matching.drift_px, {0, 1e4},
           "[px] by which worlds may look shifted, in a first attempt to match");
  v.count("least_landmarks", c.limiter.least_landmarks, {1, 256},
          "in an answer; if a peer's share is smaller, answers get rarer");
  v.count("max_landmarks", c.limiter.max_landmarks, {1, 256}, "in an answer");
  v.number("landmarks_per_s", c.limiter.landmarks_per_s, {0, 1e6},
           "[1/s] that all peers share; 0: no bound");
  v.number("least_found_share", c.least_found_share, {0, 1},
           "of the landmarks in sight, while a peer's world is unknown");
  v.number("patch_spacing_px", c.matching.patch.spacing_px, {0.5, 10},
           "[px] between samples of a landmark");
  v.number("patch_max_shift_px", c.matching.patch.max_shift_px, {0.1, 100},
           "[px] from where it should be");
  v.number("patch_min_correlation", c.matching.patch.min_correlation, {0, 1}, "of what is found");
  v.number("aligned_sigma_px", c.matching.aligned_sigma_px, {0.01, 100},
           "[px] of what is found, beside what its alignment claims");
  v.number("aligned_scale", c.matching.aligned_scale, {0, 100},
           "by which errors are larger than an alignment claims");
  v.number("in_place_px", c.matching.in_place_px, {0.01, 100},
           "[px] to which those agree that are found where they are expected");
  v.number("in_place_share", c.matching.in_place_share, {0, 1},
           "of what is found there, that agrees");
  v.count("images", c.matching.images, {1, 1000}, "kept, each 0.5 MB, to look for landmarks in");
  v.number("depth_memory_s", c.depth_memory_s, {0, 1e3}, "[s] over which depths are measured");
  v.number("max_relative_sigma", c.matching.max_relative_sigma, {1e-3, 10},
           "of landmarks that are sent or accepted, over their distance");
}

void visit_matching(CollaboratorConfig& c, ConfigVisitor& v) {
  KeyframeMatcherConfig& m = c.matching;
  v.count("match_max_distance_bits", m.descriptors.max_distance_bits, {0, 64}, "of 64");
  v.number("match_ratio", m.descriptors.ratio, {0.01, 1}, "best to second best distance");
  v.number("verify_inlier_px", m.verification.inlier_px, {0.01, 100}, "[px] reprojection error");
  v.count("verify_min_inliers", m.verification.min_inliers, {3, 1e4}, "landmarks");
  v.number("verify_min_inlier_share", m.verification.min_inlier_share, {0, 1},
           "of the descriptor matches");
  v.count("verify_max_iterations", m.verification.max_iterations, {1, 1e6}, "of RANSAC");
  v.number("verify_max_offset_sigma_m", m.verification.max_offset_sigma, {0, 1e6},
           "[m] left by the inliers at 1 px");
  v.number("verify_max_offset_m", m.verification.max_offset, {0, 1e6},
           "[m] between where a peer's world is known to lie and where it is found");
  v.angle("verify_max_yaw_deg", m.verification.max_yaw, {0, 180}, "[deg] the same");
  v.number("guided_radius_px", m.guided.radius_px, {0.01, 100},
           "[px] about where a peer's landmark must appear");
  v.count("guided_max_distance_bits", m.guided.max_distance_bits, {0, 64}, "of 64");
  v.count("min_matches", m.min_matches, {1, 1e4}, "landmarks; fewer are no matches");
  v.number("matching_sigma_px", m.sigma_px, {0, 100},
           "[px] to which two descriptors agree on a corner");
}

void visit_fusion(FusionConfig& fusion, ConfigVisitor& v) {
  v.option(
      "mode", fusion.mode, {"joint", "ci"},
      "a filter over all drones' drift, or the paper's covariance intersection in the own one");
  v.count("max_keyframes", fusion.drift.max_keyframes, {4, 1000}, "whose drift is estimated");
  v.number("gate_confidence", fusion.drift.gate_confidence, {0.5, 0.999999},
           "share of good relative poses that pass the chi-square gate");
  v.number("least_claim", fusion.drift.claims.least_claim, {0, 1},
           "of the own drift's variance; a peer that claims less is not believed");
  v.number("found_position_sigma_m", fusion.drift.claims.found_position_sigma_m, {0, 1},
           "[m] added to what a peer says to have found of own landmarks");
  v.angle("found_angle_sigma_deg", fusion.drift.claims.found_angle_sigma, {0, 10},
          "[deg] the same");
  v.flag("common_start", fusion.drift.common_start,
         "all drones start in one world; otherwise peers' worlds are aligned first");
  v.option("starts", fusion.starts, {"auto", "exact", "measured"},
           "how well drones know where they start in it; auto: exactly from ground truth, else as "
           "measured");
  v.number("start_position_sigma_m", fusion.start_position_sigma_m, {0, 1e3},
           "[m] of a peer's start, seen from the own one, where starts are measured");
  v.angle("start_yaw_sigma_deg", fusion.start_yaw_sigma, {0, 3},
          "[deg] of its heading; who knows less of it starts with fusion.common_start false");
  WorldVoteConfig& alignment = fusion.drift.alignment;
  v.count("alignment_votes", alignment.votes, {2, 100},
          "relative poses that must agree before a peer's world is aligned");
  v.number("alignment_spread", alignment.spread, {0, 100},
           "[rad] by which the most different of their views differ (way over depth, plus the "
           "angle): one view is not enough");
  v.number("alignment_agree_m", alignment.agree_m, {1e-3, 100}, "[m]");
  v.angle("alignment_agree_deg", alignment.agree_rad, {0.01, 90}, "[deg]");
  v.angle("alignment_max_tilt_deg", alignment.max_tilt_rad, {0.01, 90},
          "[deg] between two worlds, whose gravity is one");
  v.number("alignment_share", alignment.share, {0, 1}, "of what was seen must agree");
  v.count("alignment_moves", fusion.drift.max_moves, {0, 1000},
          "how often a peer's world may be found elsewhere than it was believed");
}

void visit_onboard(OnboardConfig& onboard, ConfigVisitor& v) {
  v.count("domain", onboard.domain, {0, 200}, "DDS domain of camera, IMU and autopilot");
  v.flag("loopback_only", onboard.loopback_only, "all of them run on this computer");
  v.flag("reliable", onboard.reliable,
         "ask for lost samples again; drivers that offer best effort alone are then not heard");
  v.text("image_topic", onboard.image_topic,
         "sensor_msgs/Image: grey of 8 or 16 bits, or 8-bit colours");
  v.text("imu_topic", onboard.imu_topic, "of imu_message");
  v.option("imu_message", onboard.imu_message, {"ros", "px4"},
           "sensor_msgs/Imu, or px4_msgs/SensorCombined (fmu/out/sensor_combined)");
  v.number("odometry_rate_hz", onboard.odometry_rate_hz, {0, 1000},
           "[Hz] at most, at the newest IMU sample; 0: at each image");
  v.text("odometry_topic", onboard.odometry_topic, "nav_msgs/Odometry that is told; empty: none");
  v.text("px4_topic", onboard.px4_topic,
         "px4_msgs/VehicleOdometry that is told, fmu/in/vehicle_visual_odometry; empty: none");
  Eigen::Vector3d& mount = onboard.imu_mount_rpy;
  v.angle("imu_roll_deg", mount.x(), {-360, 360},
          "[deg] of the IMU in PX4's body: its axes from forward, left, up, roll first");
  v.angle("imu_pitch_deg", mount.y(), {-360, 360}, "[deg]");
  v.angle("imu_yaw_deg", mount.z(), {-360, 360}, "[deg]");
}

void visit_link(LinkConfig& link, ConfigVisitor& v) {
  v.text("team", link.team, "teams do not hear each other");
  v.count("domain", link.domain, {0, 200}, "DDS domain");
  v.count("max_agents", link.max_agents, {2, kMaxAgents}, "in a team");
  v.count("team_size", link.team_size, {0, kMaxAgents}, "drones there will be; 0: not known");
  v.flag("loopback_only", link.loopback_only, "nothing leaves this machine");
  v.texts("interfaces", link.interfaces, "own IPv4 addresses to use; empty: all");
  v.texts("initial_peers", link.initial_peers, "IPv4 hosts of other drones");
  v.text("discovery_server", link.discovery_server,
         "IPv4:PORT of one, for discovery.mode server of a profile");
  v.text("security", link.security,
         "folder of this team's keys, made by covey keys; empty: an open link");
  v.count("inbox_limit", link.inbox_limit, {1, 1e6}, "messages not yet taken");
  v.count("max_memory_mib", link.max_memory_mib, {16, 1e5},
          "[MiB] of its own in the link's process; beyond, it is started anew");
}

void visit_profile_choice(ProfileChoice& choice, ConfigVisitor& v) {
  v.text("profile", choice.name, "how the link behaves on its radio; covey qos lists them");
  v.text("profiles_file", choice.file, "own profiles, instead of those of the program");
  v.values("override", choice.overrides,
           "single values of the profile, such as \"message.heartbeat_ms\": 80");
}

}  // namespace

void visit_config(AgentConfig& config, ConfigVisitor& visitor) {
  const auto section = [&visitor](const char* name, auto& values, auto... visits) {
    visitor.begin_section(name);
    (visits(values, visitor), ...);
    visitor.end_section();
  };
  section("agent", config.agent, visit_agent);
  section("initialisation", config.initialisation, visit_initialisation);
  section("thermal", config.thermal, visit_thermal, visit_temporal, visit_spatial, visit_stripes,
          visit_image_defects, visit_tone);
  section("tracker", config.tracker, visit_tracker, visit_alignment, visit_corners, visit_outliers);
  section("estimator", config.estimator, visit_estimator, visit_features, visit_calibration,
          visit_standing_still);
  section("collaboration", config.collaboration, visit_collaboration, visit_matching);
  section("fusion", config.fusion, visit_fusion);
  section("onboard", config.onboard, visit_onboard);
  visitor.begin_section("link");
  visit_profile_choice(config.link_profile, visitor);
  visit_link(config.link, visitor);
  visitor.end_section();
}

}  // namespace covey
