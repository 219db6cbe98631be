/* Two drives and their mechanisms, stepped by themselves: a check on the laws of `rig`, none of whose code is used here.
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
