/* Calls controllerLee of crazyflie-firmware (crazyflie/, see README.md) unchanged, in manual mode with
   a thrust of 0.3 N, k_R = 8, k_Omega = 4, J = (1, 2, 3) and no integral. */
#include "crazyflie/math3d.h"
#include "crazyflie/stabilizer_types.h"
#include "crazyflie/controller_lee.h"
#define GRAVITY_MAGNITUDE (9.81f)
static float powerDistributionGetMaxThrust(void) { return 0.6f; } /* N */
#include "crazyflie/cut.h"

typedef struct {
    float t, q[4], gyro[3], rpy_d[3], R_d[9], desired_velocity[3], desired_acceleration[3];
} crazyflie_input;
typedef struct {
    float unused;
} crazyflie_numbers;
typedef struct {
    float unused;
} crazyflie_memory;

void crazyflie_torque(const crazyflie_numbers *n, crazyflie_memory *m, const crazyflie_input *in,
                      float torque[3])
{
    controllerLee_t law = {0};
    control_t control = {0};
    setpoint_t want = {0};
    sensorData_t sensors = {0};
    state_t state = {0};
    const float *w = in->desired_velocity, by = 0.3f; /* the thrust over the mass of 1 kg */
    float jerk[3];
    int i;
    (void)n, (void)m;
    law.mass = 1.0f;
    law.J = mkvec(1, 2, 3);
    law.KR = vrepeat(8);
    law.Komega = vrepeat(4);
    for (i = 0; i < 3; i++) /* from which it computes the desired roll and pitch rates */
        jerk[i] = by * (in->R_d[3 * i] * w[1] - in->R_d[3 * i + 1] * w[0]);
    state.attitudeQuaternion.x = in->q[0], state.attitudeQuaternion.y = in->q[1];
    state.attitudeQuaternion.z = in->q[2], state.attitudeQuaternion.w = in->q[3];
    sensors.gyro.x = in->gyro[0], sensors.gyro.y = in->gyro[1], sensors.gyro.z = in->gyro[2];
    want.mode.yaw = modeAbs;
    want.attitude.roll = in->rpy_d[0], want.attitude.pitch = -in->rpy_d[1];
    want.attitude.yaw = in->rpy_d[2];
    want.attitudeRate.yaw = degrees(w[2] / in->R_d[8]);
    want.jerk.x = jerk[0], want.jerk.y = jerk[1], want.jerk.z = jerk[2];
    want.thrust = UINT16_MAX / 2.0f;
    controllerLee(&law, &control, &want, &sensors, &state, 0);
    for (i = 0; i < 3; i++)
        torque[i] = control.torque[i];
}
