"""Names of the topics that a bag of a recording has.

Cameras and IMU are EuRoC's and TUM-VI's. Truth has no place in theirs that is the IMU's own (their motion
capture is of markers), so it has topics of its own: standard messages, one thing each, exact in every digit.
"""

IMU = "/imu0"
"""sensor_msgs/Imu."""
TRUTH_POSE = "/ground_truth/pose"
"""geometry_msgs/PoseStamped: T_WB."""
TRUTH_VELOCITY = "/ground_truth/velocity"
"""geometry_msgs/Vector3Stamped: v_WB [m/s] in W."""
TRUTH_GYROSCOPE_BIAS = "/ground_truth/gyroscope_bias"
"""geometry_msgs/Vector3Stamped: b_g [rad/s] in B."""
TRUTH_ACCELEROMETER_BIAS = "/ground_truth/accelerometer_bias"
"""geometry_msgs/Vector3Stamped: b_a [m/s^2] in B."""
MARKERS = ("/vicon/firefly_sbx/firefly_sbx", "/leica/position", "/vrpn_client/raw_transform")
"""Motion capture of EuRoC and TUM-VI: where a marker is, not the IMU."""
COMPRESSED = "/compressed"
"""What the topic of a camera ends in when its images are sensor_msgs/CompressedImage."""


def camera(index: int) -> str:
    """sensor_msgs/Image of a camera."""
    return f"/cam{index}/image_raw"
