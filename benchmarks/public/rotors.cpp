// Calls ComputeDesiredAngularAcc of RotorS (rotors_cut.h, see README.md) unchanged, with
// k_R = 8, k_Omega = 4 and J = (1, 2, 3), by which its gains are divided.
#include <Eigen/Dense>
#include <cmath>

typedef struct {
    double t, pose[9], velocity[3], desired_pose[9], desired_velocity[3], desired_acceleration[3];
} rotors_input;
typedef struct {
    double unused;
} rotors_numbers;
typedef struct {
    double unused;
} rotors_memory;

static inline void vectorFromSkewMatrix(Eigen::Matrix3d &S, Eigen::Vector3d *v)
{
    *v << S(2, 1), S(0, 2), S(1, 0);
}

struct LeePositionController {
    struct { Eigen::Quaterniond orientation; Eigen::Vector3d angular_velocity; } odometry_;
    struct {
        double yaw, yaw_rate;
        double getYaw() const { return yaw; }
        double getYawRate() const { return yaw_rate; }
    } command_trajectory_;
    Eigen::Vector3d normalized_attitude_gain_, normalized_angular_rate_gain_;
    void ComputeDesiredAngularAcc(const Eigen::Vector3d &, Eigen::Vector3d *) const;
};
#include "rotors_cut.h"

// The desired attitude goes in as the direction of the force and the yaw that give it.
extern "C" void rotors_torque(const rotors_numbers *, rotors_memory *, const rotors_input *in,
                              double torque[3])
{
    typedef Eigen::Matrix<double, 3, 3, Eigen::RowMajor> Rows;
    const Eigen::Map<const Rows> R(in->pose), Rd(in->desired_pose);
    const Eigen::Vector3d J(1, 2, 3);
    Eigen::Vector3d ahead = Rd.col(0) * Rd(2, 2) - Rd.col(2) * Rd(2, 0), out;
    LeePositionController law;
    law.odometry_.orientation = Eigen::Quaterniond(Eigen::Matrix3d(R));
    law.odometry_.angular_velocity = Eigen::Map<const Eigen::Vector3d>(in->velocity);
    law.command_trajectory_.yaw = std::atan2(Rd(2, 2) * ahead(1), Rd(2, 2) * ahead(0));
    law.command_trajectory_.yaw_rate = in->desired_velocity[2];
    law.normalized_attitude_gain_ = 8.0 * J.cwiseInverse();
    law.normalized_angular_rate_gain_ = 4.0 * J.cwiseInverse();
    law.ComputeDesiredAngularAcc(-Rd.col(2), &out);
    for (int i = 0; i < 3; i++)
        torque[i] = out(i);
}
