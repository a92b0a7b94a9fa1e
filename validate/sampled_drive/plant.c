/* A saturating synchronous machine on a two-level inverter, advanced by one control period.

   Coenergy of a phase set, currents i_d, i_q of the rotor's frame, x = i_d + magnet_current:
     leak_d i_d^2/2 + leak_q i_q^2/2 + magnet i_d
     + own_d  knee_d^2  (sqrt(1 + (x/knee_d)^2) - 1)                    square-root saturation
     + own_q  knee_q^2  (y atan y - log(1 + y^2)/2), y = i_q/knee_q     arctan saturation
     + shared knee_s^2  (sqrt(1 + (x^2 + ratio^2 i_q^2)/knee_s^2) - 1)  iron that both axes use
     + (i_d + bend i_q^2/2) C + (i_q + bend i_d i_q) D                  harmonics of the angle
   with C, D = sums of a, b and c, d times cos, sin of order times angle. Fluxes are its gradient,
   inductances its second derivatives, so that reciprocity holds in currents and angle. */
#include <math.h>
#include <stdlib.h>

#define ORDERS 4

typedef struct {
    double resistance, leak_d, leak_q, magnet, magnet_current, own_d, knee_d, own_q, knee_q, shared,
        knee_s, ratio, bend, iron_conductance;
    double order[ORDERS], a[ORDERS], b[ORDERS], c[ORDERS], d[ORDERS];
} Machine;

/* Drop of a device at current i: thermal asinh(i / (2 saturation)), the law of a junction. */
typedef struct {
    double period, dead_time, node_capacitance, thermal, saturation;
    int switched;
} Inverter;

/* coenergy, psi_d, psi_q, L_dd, L_dq, L_qq, dpsi_d/dangle, dpsi_q/dangle, dcoenergy/dangle */
typedef struct {
    double w, psi_d, psi_q, l_dd, l_dq, l_qq, slope_d, slope_q, slope_w;
} Jet;

void machine_jet(const Machine *m, double i_d, double i_q, double angle, Jet *j)
{
    double x = i_d + m->magnet_current, r2 = m->ratio * m->ratio, k2 = m->knee_s * m->knee_s;
    double root = sqrt(1 + x * x / (m->knee_d * m->knee_d)), y = i_q / m->knee_q;
    double s = sqrt(1 + (x * x + r2 * i_q * i_q) / k2), s3 = s * s * s, c = 0, d = 0, ct = 0, dt = 0;
    j->w = (m->leak_d * i_d * i_d + m->leak_q * i_q * i_q) / 2 + m->magnet * i_d
         + m->own_d * m->knee_d * m->knee_d * (root - 1)
         + m->own_q * m->knee_q * m->knee_q * (y * atan(y) - log1p(y * y) / 2)
         + m->shared * k2 * (s - 1);
    j->psi_d = m->leak_d * i_d + m->magnet + m->own_d * x / root + m->shared * x / s;
    j->psi_q = m->leak_q * i_q + m->own_q * m->knee_q * atan(y) + m->shared * r2 * i_q / s;
    j->l_dd = m->leak_d + m->own_d / (root * root * root) + m->shared * (1 / s - x * x / (k2 * s3));
    j->l_qq = m->leak_q + m->own_q / (1 + y * y)
            + m->shared * r2 * (1 / s - r2 * i_q * i_q / (k2 * s3));
    j->l_dq = -m->shared * r2 * x * i_q / (k2 * s3);
    for (int n = 0; n < ORDERS && m->order[n] > 0; n++) {
        double cosine = cos(m->order[n] * angle), sine = sin(m->order[n] * angle);
        c += m->a[n] * cosine + m->b[n] * sine;
        d += m->c[n] * cosine + m->d[n] * sine;
        ct += m->order[n] * (m->b[n] * cosine - m->a[n] * sine);
        dt += m->order[n] * (m->d[n] * cosine - m->c[n] * sine);
    }
    double by_c_q = m->bend * i_q, by_d_q = 1 + m->bend * i_d; /* d/di_q of what C and D weigh */
    double f = i_d + m->bend * i_q * i_q / 2, g = i_q * by_d_q;
    j->w += f * c + g * d;
    j->psi_d += c + by_c_q * d;
    j->psi_q += by_c_q * c + by_d_q * d;
    j->l_dq += m->bend * d;
    j->l_qq += m->bend * c;
    j->slope_d = ct + by_c_q * dt;
    j->slope_q = by_c_q * ct + by_d_q * dt;
    j->slope_w = f * ct + g * dt;
}

/* Current at the terminals: that of the windings and what the iron takes of the rotation. */
void terminal_current(const Machine *m, const double *i, double angle, double speed, double *out)
{
    Jet j;
    machine_jet(m, i[0], i[1], angle, &j);
    out[0] = i[0] - m->iron_conductance * speed * j.psi_q;
    out[1] = i[1] + m->iron_conductance * speed * j.psi_d;
}

typedef struct {
    const Machine *m;
    const Inverter *v;
    const double *duty;
    double link, angle, speed, middle; /* middle: of the interval between two edges */
} Drive;

static double clamped(double x, double low, double high) { return fmin(fmax(x, low), high); }

/* Mean volts that a leg loses to dead time: a node that its current recharges loses less. */
static double lost_to_dead_time(const Inverter *v, double i, double link)
{
    double full = link * v->dead_time / v->period, size = fabs(i);
    double swing = v->dead_time > 0 ? v->node_capacitance * link / v->dead_time : 0;
    if (full == 0 || size == 0)
        return 0;
    return copysign(size > swing ? full * (1 - swing / (2 * size)) : full * size / (2 * swing), i);
}

static double node_of(const Drive *s, int k, double t, double i)
{
    const Inverter *v = s->v;
    double up = (1 - s->duty[k]) * v->period / 2, down = (1 + s->duty[k]) * v->period / 2;
    double drop = v->thermal * asinh(i / (2 * v->saturation)), per_second, tiny = 1e-15;
    if (!v->switched)
        return s->duty[k] * s->link - drop - lost_to_dead_time(v, i, s->link);
    per_second = -i / fmax(v->node_capacitance, tiny);
    if (s->middle < up || s->middle > down + v->dead_time)
        return -drop;
    if (s->middle < up + v->dead_time)
        return clamped(per_second * (t - up), 0, s->link) - drop;
    if (s->middle < down)
        return s->link - drop;
    return clamped(s->link + per_second * (t - down), 0, s->link) - drop;
}

static void rate(const Drive *s, double t, const double *i, double *out)
{
    const Machine *m = s->m;
    double angle = s->angle + s->speed * t, cosine = cos(angle), sine = sin(angle), at[2];
    Jet j;
    machine_jet(m, i[0], i[1], angle, &j);
    at[0] = i[0] - m->iron_conductance * s->speed * j.psi_q;
    at[1] = i[1] + m->iron_conductance * s->speed * j.psi_d;
    double alpha = at[0] * cosine - at[1] * sine, beta = at[0] * sine + at[1] * cosine;
    double half = sqrt(3) / 2 * beta;
    double a = node_of(s, 0, t, alpha), b = node_of(s, 1, t, half - alpha / 2);
    double c = node_of(s, 2, t, -half - alpha / 2);
    double u_alpha = (2 * a - b - c) / 3, u_beta = (b - c) / sqrt(3);
    double e_d = u_alpha * cosine + u_beta * sine - m->resistance * at[0] + s->speed * j.psi_q
               - s->speed * j.slope_d;
    double e_q = u_beta * cosine - u_alpha * sine - m->resistance * at[1] - s->speed * j.psi_d
               - s->speed * j.slope_q;
    double det = j.l_dd * j.l_qq - j.l_dq * j.l_dq;
    out[0] = (j.l_qq * e_d - j.l_dq * e_q) / det;
    out[1] = (j.l_dd * e_q - j.l_dq * e_d) / det;
}

static void runge_kutta_4(const Drive *s, double t, double h, double *i)
{
    double k1[2], k2[2], k3[2], k4[2], x[2];
    rate(s, t, i, k1);
    for (int n = 0; n < 2; n++) x[n] = i[n] + h / 2 * k1[n];
    rate(s, t + h / 2, x, k2);
    for (int n = 0; n < 2; n++) x[n] = i[n] + h / 2 * k2[n];
    rate(s, t + h / 2, x, k3);
    for (int n = 0; n < 2; n++) x[n] = i[n] + h * k3[n];
    rate(s, t + h, x, k4);
    for (int n = 0; n < 2; n++) i[n] += h / 6 * (k1[n] + 2 * k2[n] + 2 * k3[n] + k4[n]);
}

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Advance the currents i of the windings by one period; no step is longer than `longest`. */
void advance(const Machine *m, const Inverter *v, double *i, double angle, double speed,
             const double *duty, double link, double longest)
{
    Drive s = {m, v, duty, link, angle, speed, 0};
    double edges[14] = {0, v->period};
    int count = 2;
    for (int k = 0; v->switched && k < 3; k++)
        for (int side = -1; side < 2; side += 2) {
            edges[count] = (1 + side * duty[k]) * v->period / 2;
            edges[count + 1] = edges[count] + v->dead_time;
            count += 2;
        }
    qsort(edges, count, sizeof(double), ascending);
    for (int n = 0; n + 1 < count; n++) {
        double begin = edges[n], span = edges[n + 1] - begin;
        double most = v->switched && span <= v->dead_time ? fmin(longest, v->dead_time / 6) : longest;
        int steps = (int)ceil(span / most);
        s.middle = begin + span / 2;
        for (int k = 0; k < steps; k++)
            runge_kutta_4(&s, begin + k * span / steps, span / steps, i);
    }
}
