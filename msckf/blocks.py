"""Names of the blocks of the navigation error state, `dtheta, dp, dv, db_g, db_a`."""

THETA, POSITION, VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9)
GYRO_BIAS, ACCEL_BIAS = slice(9, 12), slice(12, 15)
MOTION, BIASES = slice(0, 9), slice(9, 15)
IMU_SIZE = 15
