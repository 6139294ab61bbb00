#pragma once
typedef double real;
typedef struct {
    real t, pose[9], velocity[3], desired_pose[9], desired_velocity[3], desired_acceleration[3];
} lee_input;
typedef struct {
    real kR, kW, J[3]; /* N m/rad, N m s/rad, kg m^2 */
} lee_numbers;
typedef struct {
    real unused;
} lee_memory;
