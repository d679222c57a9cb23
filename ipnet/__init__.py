"""What raw IMU data alone says of its biases: labels, a network, motion models, and their rivals."""
