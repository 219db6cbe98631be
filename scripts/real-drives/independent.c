/* Three drives and their mechanisms, stepped by themselves: a check on the laws of `rig`, none of whose code is used here.
   Steps are linearly implicit in friction and braking. SI throughout. */
#include <math.h>

/* Friction over rate: dry with Stribeck's share, and the gear's share of what the motor exerts. */
static double per_rate(double dry, double share, double stribeck, double driving, double driven, double push, double v, double rate) {
    double over = v / stribeck;
    double at_rate = dry * (1 + share * exp(-over * over)) + (push * v < 0 ? driven : driving) * fabs(push);
    return at_rate / sqrt(v * v + rate * rate);
}

/* A servo that turns a weight on a bar. p: armature, gain at the register's 100, viscous, braking, dry, driving, driven, delay, zero, mass of the bar. */
void servo(const double *p, int rows, const double *t, const double *goal, const double *on, double gain, double q, double *angle) {
    const double weight = 0.49, length = 0.1, g = 9.81, rate = 0.01, longest = 5e-4;
    double inertia = weight * length * length + p[9] * length * length / 3 + p[0] + 1e-4;
    double torque = g * (weight * length + p[9] * length / 2), kp = p[1] * gain / 100, v = 0;
    for (int row = 0, told = 0; row < rows; row++) {
        angle[row] = q;
        if (row + 1 == rows) break;
        double lasts = t[row + 1] - t[row];
        int steps = (int)(lasts / longest) + 1;
        double h = lasts / steps;
        for (int step = 0; step < steps; step++) {
            while (told + 1 < rows && t[told + 1] <= t[row] + step * h - p[7]) told++;
            int is_on = on[row] > 0.5;
            double motor = is_on ? kp * (goal[told] - q) : 0, braking = is_on ? p[3] : 0;
            double rubs = per_rate(p[4], 0, 1, p[5], p[6], motor - braking * v, v, rate);
            double b = p[2] + braking + rubs, k = torque * cos(q) + (is_on ? kp : 0);
            double next = (inertia * v + h * (motor - torque * sin(q + p[8]))) / (inertia + h * b + 0.25 * h * h * k);
            q += 0.5 * h * (v + next);
            v = next;
        }
    }
}

/* A car on a screw. p: mass, viscous, dry, offset, Stribeck's share, its rate, driving, driven. */
void axis(const double *p, int rows, double every, const double *force, double x, double v, double *place) {
    const double rate = 0.001;
    const int steps = 4;
    for (int row = 0; row < rows; row++) {
        place[row] = x;
        double from = force[row], to = row + 1 < rows ? force[row + 1] : from, h = every / steps;
        for (int step = 0; step < steps; step++) {
            double f = from + (to - from) * (step + 0.5) / steps;
            double b = p[1] + per_rate(p[2], p[4], p[5], p[6], p[7], f, v, rate);
            double next = (v + h * (f - p[3]) / p[0]) / (1 + h * b / p[0]);
            x += 0.5 * h * (v + next);
            v = next;
        }
    }
}

/* Two links with a motor at each joint, the second angle relative to the first. p: inertia of the first with the second's mass at its end, of the second, coupling,
   first moments of both (kg m), two rotors, two viscous, two dry, two offsets, two zeros, driving, driven, rate of turning round, Stribeck's share, its rate. */
void pendulum(const double *p, int rows, const double *t, const double *torque, double a, double b, double va, double vb, double *angle) {
    const double g = 9.81, longest = 1e-3;
    double q[2] = {a + p[13], b + p[14]}, v[2] = {va, vb};
    for (int row = 0; row < rows; row++) {
        for (int i = 0; i < 2; i++) angle[2 * row + i] = q[i] - p[13 + i];
        if (row + 1 == rows) break;
        double lasts = t[row + 1] - t[row];
        int steps = (int)(lasts / longest) + 1;
        double h = lasts / steps;
        for (int step = 0; step < steps; step++) {
            double share = (step + 0.5) / steps, rubs[2], push[2];
            for (int i = 0; i < 2; i++) {
                double from = torque[2 * row + i], to = torque[2 * row + 2 + i];
                push[i] = from + share * (to - from) + p[11 + i];
                rubs[i] = p[7 + i] + per_rate(p[9 + i], p[18], p[19], p[15], p[16], push[i], v[i], p[17]);
            }
            double c = cos(q[1]), s = sin(q[1]), low = g * p[4] * sin(q[0] + q[1]);
            double m11 = p[0] + p[1] + 2 * p[2] * c + p[5], m12 = p[1] + p[2] * c, m22 = p[1] + p[6];
            double f1 = push[0] + p[2] * s * v[1] * (2 * v[0] + v[1]) - g * p[3] * sin(q[0]) - low - rubs[0] * v[0];
            double f2 = push[1] - p[2] * s * v[0] * v[0] - low - rubs[1] * v[1];
            m11 += h * rubs[0];
            m22 += h * rubs[1];
            double det = m11 * m22 - m12 * m12;
            double d[2] = {h * (m22 * f1 - m12 * f2) / det, h * (m11 * f2 - m12 * f1) / det};
            for (int i = 0; i < 2; i++) {
                q[i] += h * (v[i] + 0.5 * d[i]);
                v[i] += d[i];
            }
        }
    }
}
