// Calls NonlinearGeometricControl::Update of mavros_controllers (mavros_cut.h, see README.md)
// unchanged. It commands rates, which are read as a torque with 2/tau = k_R = 8.
#include <Eigen/Dense>

struct NonlinearGeometricControl {
    double attctrl_tau_;
    Eigen::Vector3d desired_rate_, desired_thrust_;
    void Update(Eigen::Vector4d &, const Eigen::Vector4d &, const Eigen::Vector3d &,
                const Eigen::Vector3d &);
};
#include "mavros_cut.h"

typedef struct {
    double q[4], q_d[4], t, velocity[3], desired_velocity[3], desired_acceleration[3];
} mavros_input;
typedef struct {
    double unused;
} mavros_numbers;
typedef struct {
    double unused;
} mavros_memory;

extern "C" void mavros_torque(const mavros_numbers *, mavros_memory *, const mavros_input *in,
                              double torque[3])
{
    NonlinearGeometricControl law = {2.0 / 8.0};
    Eigen::Vector4d now = Eigen::Map<const Eigen::Vector4d>(in->q);
    law.Update(now, Eigen::Map<const Eigen::Vector4d>(in->q_d), Eigen::Vector3d::UnitZ(),
               Eigen::Vector3d::Zero());
    for (int i = 0; i < 3; i++)
        torque[i] = law.desired_rate_(i);
}
