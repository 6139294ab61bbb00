// Attitude as in so3.py, as a user of Boost writes it in C++: one run after the other by odeint.

#include <array>
#include <cmath>

#include <boost/numeric/odeint.hpp>

namespace odeint = boost::numeric::odeint;

using State = std::array<double, 24>; // R, omega, R_d, omega_d
using Vector = std::array<double, 3>;

struct Matrix {
    double a[3][3];
};

static Matrix matrix(const double *from)
{
    Matrix found;
    for (int i = 0; i < 9; i++)
        found.a[i / 3][i % 3] = from[i];
    return found;
}

static Matrix transposed(const Matrix &m)
{
    Matrix found;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            found.a[i][j] = m.a[j][i];
    return found;
}

static Matrix operator*(const Matrix &m, const Matrix &n)
{
    Matrix found{};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                found.a[i][j] += m.a[i][k] * n.a[k][j];
    return found;
}

static Vector operator*(const Matrix &m, const Vector &v)
{
    Vector found;
    for (int i = 0; i < 3; i++)
        found[i] = m.a[i][0] * v[0] + m.a[i][1] * v[1] + m.a[i][2] * v[2];
    return found;
}

static Vector operator*(double c, const Vector &v) { return {c * v[0], c * v[1], c * v[2]}; }
static Vector operator+(const Vector &v, const Vector &w)
{
    return {v[0] + w[0], v[1] + w[1], v[2] + w[2]};
}
static Vector operator-(const Vector &v, const Vector &w) { return v + -1.0 * w; }

static Vector cross(const Vector &v, const Vector &w)
{
    return {v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]};
}

static Vector desired_torque(double t)
{
    return {std::cos(t), std::sin(t), std::cos(t) * std::sin(t)};
}

enum Law { EQT, GT, NOG, ASYM };

struct ClosedLoop {
    Law law;
    Matrix inertia, inverse, K_p, K_d;

    Vector torque(double t, const Matrix &R, const Vector &w, const Matrix &R_d,
                  const Vector &w_d) const
    {
        const Matrix R_E = R * transposed(R_d), B = transposed(R_E) * transposed(K_p);
        const Matrix A = K_p * R_E;
        const Vector twisted = {A.a[2][1] - B.a[2][1], A.a[0][2] - B.a[0][2],
                                A.a[1][0] - B.a[1][0]};
        const Vector error = w - w_d, momentum = inertia * w, desired = inertia * w_d;
        Vector feedforward{};
        switch (law) {
        case EQT: // eq. (23)
            feedforward = cross(error, desired) + cross(w_d, inertia * error);
            break;
        case GT: // eq. (24)
            feedforward = 0.5 * (inertia * cross(w, w_d)) + 0.5 * cross(w, desired)
                          + 0.5 * cross(w_d, momentum) - cross(w_d, desired);
            break;
        case NOG:
            feedforward = cross(w_d, inertia * error);
            break;
        case ASYM:
            feedforward = cross(error, desired) + 0.5 * cross(w_d, inertia * error)
                          + 0.5 * (inertia * cross(w, w_d));
        }
        const Vector damping =
            law == GT ? K_d * error : transposed(R_d) * (K_d * (R_d * error));
        return desired_torque(t) + feedforward - damping - transposed(R_d) * twisted;
    }

    void operator()(const State &y, State &rate, double t) const
    {
        const Matrix R = matrix(&y[0]), R_d = matrix(&y[12]);
        const Vector w = {y[9], y[10], y[11]}, w_d = {y[21], y[22], y[23]};
        const Vector tau = torque(t, R, w, R_d, w_d);
        turn(R, w, tau, &rate[0]);
        turn(R_d, w_d, desired_torque(t), &rate[12]);
    }

    void turn(const Matrix &R, const Vector &w, const Vector &tau, double *rate) const
    {
        const Matrix skew = {{{0, -w[2], w[1]}, {w[2], 0, -w[0]}, {-w[1], w[0], 0}}};
        const Matrix R_rate = R * skew;
        const Vector w_rate = inverse * (cross(inertia * w, w) + tau);
        for (int i = 0; i < 9; i++)
            rate[i] = R_rate.a[i / 3][i % 3];
        for (int i = 0; i < 3; i++)
            rate[9 + i] = w_rate[i];
    }
};

// Integrates runs of a law; body is I, its inverse, K_p and K_d, found is (runs, samples, 24).
extern "C" void integrate(int law, const double *body, int runs, const double *starts, int samples,
                          const double *times, double tolerance, double *found)
{
    const ClosedLoop loop = {static_cast<Law>(law), matrix(body), matrix(body + 9),
                             matrix(body + 18), matrix(body + 27)};
    for (int run = 0; run < runs; run++) {
        State y;
        for (int i = 0; i < 24; i++)
            y[i] = starts[24 * run + i];
        odeint::integrate_times(
            odeint::make_dense_output(tolerance * 1e-3, tolerance,
                                      odeint::runge_kutta_dopri5<State>()),
            loop, y, times, times + samples, 0.01, [&found](const State &state, double) {
                for (double value : state)
                    *found++ = value;
            });
    }
}
