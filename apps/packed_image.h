// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "comms/convert.h"
#include "comms/onboard_messages.h"

namespace covey {

// Grey out of JPEG (8 bits) or PNG (8 or 16): brightness of colours, and of Bayer's mosaics, which
// image_transport packs as they are. Rejects what is neither, is damaged or is too large.
[[nodiscard]] Decoded<CameraImage> unpacked(const PackedImage& image);

}  // namespace covey
