/* The knee EHA in plain C: the declared equations of eha_bench.plants.eha_knee and its integrator,
 * step for step, with no effects and no measured state imposed. It is what the compiled kernel is
 * held against: written as one would write this model alone.
 *
 * Parameters in the order of plants/eha_knee/parameters.py. State: w, theta, p_a, p_b, x, v, i.
 */
#include <math.h>

enum { K_T, J, B_PM, T_CF, T_SF, W_S, L_IN, D_P, BETA, V_A, V_B, A_A, A_B, M, B_ROD, F_ROD, F_EXT,
       I_MAX, G_BYPASS, LINK_A, LINK_B, LINK_C0, P_INITIAL, CREEP_ROD, CREEP_PUMP };

#define DEAD_VOLUME 0.02
#define MAX_SPLITS 8

typedef struct { double w, theta, p_a, p_b, x, v; } State;
typedef struct { double w, a, b, v, c_a, c_b, s_w, s_v; } Rates;

static double level_of(double w, const double *P) {
    double ratio = w / P[W_S];
    return P[T_CF] + (P[T_SF] - P[T_CF]) * exp(-ratio * ratio);
}

static double shaft_net(double i, const State *y, const double *P) {
    return P[K_T] * i - (P[D_P] * (y->p_a - y->p_b) + P[B_PM] * y->w);
}

static double rod_net(const State *y, double force, const double *P) {
    return P[A_A] * y->p_a - P[A_B] * y->p_b - (P[F_EXT] + force) - P[B_ROD] * y->v;
}

static double creep(double level, double net, double inertia, double speed, double width, double h,
                    double *slope) {
    double rate = (net - level * tanh(speed / width)) / inertia;
    double later = speed + h * rate;
    double slowest = speed * later <= 0.0 ? 0.0 : fmin(fabs(speed), fabs(later));
    double shape = tanh(slowest / width);
    *slope = level / (width * inertia) * (1.0 - shape * shape);
    return rate;
}

static Rates rates(double h, double i, const State *y, double dir_m, double dir_r, double bypass,
                   double force, const double *P) {
    Rates f = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    if (dir_m != 0.0) {
        double level = level_of(y->w, P), net = shaft_net(i, y, P);
        if (P[CREEP_PUMP] > 0.0) f.w = creep(level, net, P[J], y->w, P[CREEP_PUMP], h, &f.s_w);
        else f.w = (net - dir_m * level) / P[J];
    }
    double q_ab = (P[L_IN] + bypass) * (y->p_a - y->p_b);
    double q_pump = P[D_P] * y->w;
    double v_a = fmax(P[V_A] + P[A_A] * y->x, DEAD_VOLUME * P[V_A]);
    double v_b = fmax(P[V_B] - P[A_B] * y->x, DEAD_VOLUME * P[V_B]);
    f.c_a = P[BETA] / v_a;
    f.c_b = P[BETA] / v_b;
    f.a = f.c_a * (q_pump - P[A_A] * y->v - q_ab);
    f.b = f.c_b * (P[A_B] * y->v - q_pump + q_ab);
    if (dir_r != 0.0) {
        double net = rod_net(y, force, P);
        if (P[CREEP_ROD] > 0.0) f.v = creep(P[F_ROD], net, P[M], y->v, P[CREEP_ROD], h, &f.s_v);
        else f.v = (net - dir_r * P[F_ROD]) / P[M];
    }
    return f;
}

static double direction(double net, double level) {
    return net > level ? 1.0 : net < -level ? -1.0 : 0.0;
}

static double shaft_direction(double i, const State *y, const double *P) {
    if (y->w != 0.0) return y->w > 0.0 ? 1.0 : -1.0;
    double net = shaft_net(i, y, P);
    if (P[CREEP_PUMP] > 0.0) return net >= 0.0 ? 1.0 : -1.0;
    return direction(net, level_of(0.0, P));
}

static double rod_direction(const State *y, double force, const double *P) {
    if (y->v != 0.0) return y->v > 0.0 ? 1.0 : -1.0;
    double net = rod_net(y, force, P);
    if (P[CREEP_ROD] > 0.0) return net >= 0.0 ? 1.0 : -1.0;
    return direction(net, P[F_ROD]);
}

static State step(double h, double i, const State *y, double dir_m, double dir_r, double bypass,
                  double force, const double *P) {
    Rates f = rates(h, i, y, dir_m, dir_r, bypass, force, P);
    double s = (1.0 - 1.0 / sqrt(2.0)) * h, g = P[L_IN] + bypass;
    double m_aa = 1.0 + s * f.c_a * g, m_ab = -s * f.c_a * g;
    double m_ba = -s * f.c_b * g, m_bb = 1.0 + s * f.c_b * g;
    double det = m_aa * m_bb - m_ab * m_ba;
    double m_w = 1.0 + s * f.s_w, m_v = 1.0 + s * f.s_v;
    double k_a = (m_bb * f.a - m_ab * f.b) / det, k_b = (m_aa * f.b - m_ba * f.a) / det;
    double k_w = f.w / m_w, k_v = f.v / m_v;
    State z = {y->w + h * k_w, y->theta + h * y->w, y->p_a + h * k_a, y->p_b + h * k_b,
               y->x + h * y->v, y->v + h * k_v};
    Rates e = rates(h, i, &z, dir_m, dir_r, bypass, force, P);
    double r_a = e.a - 2.0 * k_a, r_b = e.b - 2.0 * k_b;
    double l_a = (m_bb * r_a - m_ab * r_b) / det, l_b = (m_aa * r_b - m_ba * r_a) / det;
    double l_w = (e.w - 2.0 * k_w) / m_w, l_v = (e.v - 2.0 * k_v) / m_v;
    State n = {y->w + h * (1.5 * k_w + 0.5 * l_w), y->theta + h * (y->w + 0.5 * h * k_w),
               y->p_a + h * (1.5 * k_a + 0.5 * l_a), y->p_b + h * (1.5 * k_b + 0.5 * l_b),
               y->x + h * (y->v + 0.5 * h * k_v), y->v + h * (1.5 * k_v + 0.5 * l_v)};
    return n;
}

static void substep(double h, double i, int locked, double bypass, double force, const double *P,
                    State *y) {
    double left = h;
    double x_max = fmin(P[V_A] / P[A_A], P[V_B] / P[A_B]) * (1.0 - DEAD_VOLUME);
    int stops_m = P[CREEP_PUMP] <= 0.0, stops_r = P[CREEP_ROD] <= 0.0;
    for (int split = 0; split < MAX_SPLITS; split++) {
        double dir_m = shaft_direction(i, y, P), dir_r = 0.0;
        if (!locked) {
            dir_r = rod_direction(y, force, P);
            if (y->v == 0.0 && ((y->x >= x_max && dir_r > 0.0) || (y->x <= -x_max && dir_r < 0.0)))
                dir_r = 0.0;
        }
        State n = step(left, i, y, dir_m, dir_r, bypass, force, P);
        double part = 1.0;
        int stop_m = stops_m && dir_m != 0.0 && dir_m * n.w <= 0.0;
        int stop_r = stops_r && dir_r != 0.0 && dir_r * n.v <= 0.0;
        if (stop_m) part = fmin(part, y->w != 0.0 ? y->w / (y->w - n.w) : 0.0);
        if (stop_r) part = fmin(part, y->v != 0.0 ? y->v / (y->v - n.v) : 0.0);
        if (split == MAX_SPLITS - 1) part = 1.0;
        if (part <= 0.0) {
            if (stop_m && y->w == 0.0) dir_m = 0.0;
            if (stop_r && y->v == 0.0) dir_r = 0.0;
            n = step(left, i, y, dir_m, dir_r, bypass, force, P);
            part = 1.0;
            stop_m = stops_m && dir_m != 0.0 && dir_m * n.w <= 0.0;
            stop_r = stops_r && dir_r != 0.0 && dir_r * n.v <= 0.0;
        } else if (part < 1.0) {
            int first_m = stop_m && y->w / (y->w - n.w) <= part;
            int first_r = stop_r && y->v / (y->v - n.v) <= part;
            n = step(part * left, i, y, dir_m, dir_r, bypass, force, P);
            stop_m = first_m;
            stop_r = first_r;
        }
        if (stop_m) n.w = 0.0;
        if (stop_r) n.v = 0.0;
        if (n.x > x_max) { n.x = x_max; n.v = fmin(n.v, 0.0); }
        else if (n.x < -x_max) { n.x = -x_max; n.v = fmax(n.v, 0.0); }
        *y = n;
        left *= 1.0 - part;
        if (left <= 1e-9 * h) break;
    }
}

/* n ticks; out: (n, 6) i, w, p_a, p_b, x, v, row k just before command k takes effect. */
void simulate(int n, const double *times, const double *commands, const double *forces, int locked,
              int bypass_open, double h_max, const double *P, double *Y, double *out) {
    State y = {Y[0], Y[1], Y[2], Y[3], Y[4], Y[5]};
    double current = Y[6], bypass = bypass_open ? P[G_BYPASS] : 0.0;
    for (int k = 0; k < n; k++) {
        double row[6] = {current, y.w, y.p_a, y.p_b, y.x, y.v};
        for (int c = 0; c < 6; c++) out[6 * k + c] = row[c];
        if (k == n - 1) break;
        double span = times[k + 1] - times[k];
        int count = (int)fmax(1.0, ceil(span / h_max - 1e-6));
        double h = span / count;
        current = fmin(fmax(commands[k], -P[I_MAX]), P[I_MAX]);
        for (int part = 0; part < count; part++) {
            double middle = (part + 0.5) / count;
            double force = forces[k] + middle * (forces[k + 1] - forces[k]);
            substep(h, current, locked, bypass, force, P, &y);
        }
    }
    Y[0] = y.w; Y[1] = y.theta; Y[2] = y.p_a; Y[3] = y.p_b; Y[4] = y.x; Y[5] = y.v; Y[6] = current;
}
