
/* Sets t, desired_pose, desired_velocity and desired_acceleration of what the law is told. */
void ${label}_reference($real t, ${label}_input *input);
