# SPDX-License-Identifier: Apache-2.0
"""Pictures as `sensor_msgs/Image`."""

from __future__ import annotations

import array

import numpy as np
from numpy.typing import NDArray

from mild_ros.messages.stamps import time_to_msg
from mild_ros.messages.standard import Image


def image_to_msg(pixels: NDArray[np.uint8], stamp_ns: int, frame_id: str) -> Image:
    """A picture (height, width, 3), red, green and blue, as `rgb8`.

    Args:
        pixels: Of the picture.
        stamp_ns: When it was taken.
        frame_id: Of the camera.
    """
    height, width, _ = pixels.shape
    message = Image(height=height, width=width, encoding="rgb8", step=3 * width)
    message.header.stamp = time_to_msg(stamp_ns)
    message.header.frame_id = frame_id
    # An array of bytes is taken as it is; of anything else rclpy looks at every byte.
    message.data = array.array("B", pixels.tobytes())
    return message
