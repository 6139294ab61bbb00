/* Lee, Leok and McClamroch (2010), the attitude part, as somebody types it in. */
#include "lee.h"
static void cross(const real a[3], const real b[3], real c[3])
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}
void lee_torque(const lee_numbers *n, lee_memory *m, const lee_input *in, real torque[3])
{
    real E[9], W[3], A[3], Jw[3], gyro[3], WxW[3];
    int i, j, k;
    (void)m;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            E[3 * i + j] = 0; /* Rd^T R */
            for (k = 0; k < 3; k++)
                E[3 * i + j] += in->desired_pose[3 * k + i] * in->pose[3 * k + j];
        }
    for (i = 0; i < 3; i++) {
        W[i] = A[i] = 0; /* R^T Rd Wd */
        for (j = 0; j < 3; j++) {
            W[i] += E[3 * j + i] * in->desired_velocity[j];
            A[i] += E[3 * j + i] * in->desired_acceleration[j];
        }
        Jw[i] = n->J[i] * in->velocity[i];
    }
    cross(in->velocity, Jw, gyro);
    cross(in->velocity, W, WxW);
    {
        const real eR[3] = {(E[7] - E[5]) / 2, (E[2] - E[6]) / 2, (E[3] - E[1]) / 2};
        for (i = 0; i < 3; i++)
            torque[i] = -n->kR * eR[i] - n->kW * (in->velocity[i] - W[i]) + gyro[i]
                        - n->J[i] * (WxW[i] - A[i]);
    }
}
