/* The valve-driven cylinder of fixtures/rigs/valve_cylinder/plant.yaml in plain C: its equations and
 * the integrator of the generated kernels, step for step, without effects, without friction that
 * creeps and with no measured state imposed. What the generated kernel is held against: written as
 * one would write this model alone.
 *
 * Parameters in the order of the plant's vector. State: v, x, p_in, p_a, p_b.
 */
#include <math.h>

enum { BETA, ADDED, SUPPLY, TANK, V_IN, P_IN, P_A, P_B, MASS, LOW, HIGH, G_LINE, GAIN, SCALE, NULL_BIAS,
       LAMINAR, OMEGA, ZETA, A_A, A_B, DEAD_A, DEAD_B, G_PISTON, COULOMB, VISCOUS, CREEP };

#define MAX_SPLITS 8

typedef struct { double v, x, in, a, b; } State;
typedef struct { double v, in, a, b, c_in, c_a, c_b; } Rates;
typedef struct { double in_a, in_b, a_t, ab, b_t; } Slopes;
typedef struct { double spool, rate, demand, opening, cosine, sine; } Valve;

static double top(double a, double b) { return a > b ? a : b; }
static double root(double d, double p) { return d / sqrt(sqrt(d * d + p * p)); }
static double steep(double d, double p) { return 1.0 / sqrt(sqrt(d * d + p * p)); }

static void waves(Valve *s, double h, const double *P) {
    double part = 1.0 - P[ZETA] * P[ZETA], w = P[OMEGA];
    if (part > 1e-9) {
        double own = w * sqrt(part), fade = exp(-P[ZETA] * w * h);
        s->cosine = fade * cos(own * h);
        s->sine = fade * sin(own * h) / own;
    } else if (part < -1e-9) {
        double own = w * sqrt(-part);
        double slow = exp((own - P[ZETA] * w) * h), fast = exp(-(own + P[ZETA] * w) * h);
        s->cosine = 0.5 * (slow + fast);
        s->sine = 0.5 * (slow - fast) / own;
    } else {
        s->cosine = exp(-w * h);
        s->sine = s->cosine * h;
    }
}

static void advance(Valve *s, const double *P) {
    double off = s->spool - s->demand / P[SCALE], w = P[OMEGA], z = P[ZETA];
    double spool = s->demand / P[SCALE] + off * (s->cosine + z * w * s->sine) + s->rate * s->sine;
    s->rate = s->rate * (s->cosine - z * w * s->sine) - off * w * w * s->sine;
    s->spool = spool;
    s->opening = spool + P[NULL_BIAS];
}

static double net(const State *y, const double *P) {
    return P[A_A] * y->a - P[A_B] * y->b - P[VISCOUS] * y->v;
}

static Rates rates(const State *y, double o, double dir, const double *P) {
    double l = P[LAMINAR], k = P[GAIN], up = top(0.0, o), down = top(0.0, -o);
    double q_line = P[G_LINE] * (P[SUPPLY] - y->in);
    double q_in_a = k * up * root(y->in - y->a, l), q_in_b = k * down * root(y->in - y->b, l);
    double q_a_t = k * down * root(y->a - P[TANK], l), q_b_t = k * up * root(y->b - P[TANK], l);
    double q_ab = P[G_PISTON] * (y->a - y->b);
    double v_a = top(P[DEAD_A] + P[A_A] * (y->x - P[LOW]), 0.5 * P[DEAD_A]);
    double v_b = top(P[DEAD_B] + P[A_B] * (P[HIGH] - y->x), 0.5 * P[DEAD_B]);
    Rates f;
    f.v = dir != 0.0 ? (net(y, P) - dir * P[COULOMB]) / (P[MASS] + P[ADDED]) : 0.0;
    f.c_in = P[BETA] / P[V_IN];
    f.c_a = P[BETA] / v_a;
    f.c_b = P[BETA] / v_b;
    f.in = f.c_in * (q_line - q_in_a - q_in_b);
    f.a = f.c_a * (q_in_a - q_a_t - P[A_A] * y->v - q_ab);
    f.b = f.c_b * (q_in_b - q_b_t + P[A_B] * y->v + q_ab);
    return f;
}

static Slopes slopes(const State *y, double o, const double *P) {
    double l = P[LAMINAR], k = P[GAIN], up = top(0.0, o), down = top(0.0, -o);
    Slopes g = {k * up * steep(y->in - y->a, l), k * down * steep(y->in - y->b, l),
                k * down * steep(y->a - P[TANK], l), P[G_PISTON], k * up * steep(y->b - P[TANK], l)};
    return g;
}

static State step(double h, const State *y, double o, double dir, const double *P) {
    Rates f = rates(y, o, dir, P);
    Slopes g = slopes(y, o, P);
    double s = (1.0 - 1.0 / sqrt(2.0)) * h;
    double m00 = 1.0 + s * f.c_in * (P[G_LINE] + g.in_a + g.in_b);
    double m01 = -s * f.c_in * g.in_a, m02 = -s * f.c_in * g.in_b;
    double m11 = 1.0 + s * f.c_a * (g.in_a + g.a_t + g.ab);
    double m10 = -s * f.c_a * g.in_a, m12 = -s * f.c_a * g.ab;
    double m22 = 1.0 + s * f.c_b * (g.in_b + g.ab + g.b_t);
    double m20 = -s * f.c_b * g.in_b, m21 = -s * f.c_b * g.ab;
    double f10 = m10 / m00, f20 = m20 / m00, f21;
    m11 -= f10 * m01;
    m12 -= f10 * m02;
    m21 -= f20 * m01;
    m22 -= f20 * m02;
    f21 = m21 / m11;
    m22 -= f21 * m12;

    double ra = f.a - f10 * f.in, rb = f.b - f20 * f.in - f21 * ra;
    double k_b = rb / m22, k_a = (ra - m12 * k_b) / m11, k_in = (f.in - m01 * k_a - m02 * k_b) / m00;
    State z = {y->v + h * f.v, y->x + h * y->v, y->in + h * k_in, y->a + h * k_a, y->b + h * k_b};
    Rates e = rates(&z, o, dir, P);
    double r_in = e.in - 2.0 * k_in, r_a = e.a - 2.0 * k_a, r_b = e.b - 2.0 * k_b;
    ra = r_a - f10 * r_in;
    rb = r_b - f20 * r_in - f21 * ra;
    double l_b = rb / m22, l_a = (ra - m12 * l_b) / m11, l_in = (r_in - m01 * l_a - m02 * l_b) / m00;
    State n = {y->v + h * (1.5 * f.v + 0.5 * (e.v - 2.0 * f.v)), y->x + h * (y->v + 0.5 * h * f.v),
               y->in + h * (1.5 * k_in + 0.5 * l_in), y->a + h * (1.5 * k_a + 0.5 * l_a),
               y->b + h * (1.5 * k_b + 0.5 * l_b)};
    return n;
}

static double direction(const State *y, const double *P) {
    if (y->v != 0.0) return y->v > 0.0 ? 1.0 : -1.0;
    double f = net(y, P);
    return f > P[COULOMB] ? 1.0 : f < -P[COULOMB] ? -1.0 : 0.0;
}

static void substep(double h, int locked, double o, const double *P, State *y) {
    double left = h;
    for (int split = 0; split < MAX_SPLITS; split++) {
        double dir = locked ? 0.0 : direction(y, P), part = 1.0;
        if (y->v == 0.0 && ((y->x >= P[HIGH] && dir > 0.0) || (y->x <= P[LOW] && dir < 0.0))) dir = 0.0;
        State n = step(left, y, o, dir, P);
        int stop = dir != 0.0 && dir * n.v <= 0.0;
        if (stop) part = y->v != 0.0 ? y->v / (y->v - n.v) : 0.0;
        if (split == MAX_SPLITS - 1) part = 1.0;
        if (part <= 0.0) {
            if (stop && y->v == 0.0) dir = 0.0;
            n = step(left, y, o, dir, P);
            part = 1.0;
            stop = dir != 0.0 && dir * n.v <= 0.0;
        } else if (part < 1.0) {
            n = step(part * left, y, o, dir, P);
        }
        if (stop) n.v = 0.0;
        if (n.x > P[HIGH]) { n.x = P[HIGH]; if (n.v > 0.0) n.v = 0.0; }
        else if (n.x < P[LOW]) { n.x = P[LOW]; if (n.v < 0.0) n.v = 0.0; }
        *y = n;
        left *= 1.0 - part;
        if (left <= 1e-9 * h) break;
    }
}

/* n ticks; out: (n, 4) p_a, p_b, p_in, x, row k just before command k takes effect. */
void simulate(int n, const double *times, const double *commands, int locked, double h_max,
              const double *P, double *Y, double *out) {
    State y = {Y[0], Y[1], Y[2], Y[3], Y[4]};
    Valve s = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    for (int k = 0; k < n; k++) {
        double row[4] = {y.a, y.b, y.in, y.x};
        for (int c = 0; c < 4; c++) out[4 * k + c] = row[c];
        if (k == n - 1) break;
        double span = times[k + 1] - times[k];
        int count = (int)fmax(1.0, ceil(span / h_max - 1e-6));
        double h = span / count;
        s.demand = fmin(fmax(commands[k], -P[SCALE]), P[SCALE]);
        if (k == 0) s.spool = s.demand / P[SCALE];
        waves(&s, 0.5 * h, P);
        for (int part = 0; part < count; part++) {
            advance(&s, P);
            substep(h, locked, s.opening, P, &y);
            advance(&s, P);
        }
    }
    Y[0] = y.v; Y[1] = y.x; Y[2] = y.in; Y[3] = y.a; Y[4] = y.b;
}
