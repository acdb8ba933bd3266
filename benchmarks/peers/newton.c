/* Newton for the four-bar in C. Compiled when the benchmarks run; not part of the library.
 *
 * par = {crank, coupler, rocker, ground, home B.x, B.y, home C.x, C.y, tolerance, side}
 * out = x and y of C, two arrays of n numbers; status 0 where a lane has converged on its side.
 *
 * Eight lanes are one value of GCC's and Clang's vector types, which the compiler lays on whatever registers there are.
 */
#include <math.h>
#include <string.h>

#define W 8
#define MOST 50

typedef double lanes __attribute__((vector_size(8 * W)));
typedef long long mask __attribute__((vector_size(8 * W)));

static int right_side(double bx, double by, double x, double y, const double *par)
{
    return par[9] * ((x - bx) * y - (y - by) * (x - par[3])) > 0;
}

static inline lanes absolute(lanes x) { return (lanes)((mask)x & 0x7fffffffffffffffLL); }
static inline lanes choose(mask m, lanes x, lanes y) { return (lanes)((m & (mask)x) | (~m & (mask)y)); }
static inline lanes larger(lanes x, lanes y) { return choose(x > y, x, y); }

static inline int any_not_below(lanes x, double tol)
{
    int open = 0;
    for (int l = 0; l < W; l++) open |= !(x[l] < tol);
    return open;
}

/* Sine and cosine of moderate angles to about 1e-16, without a branch: the C library's are scalar calls. */
static inline void sine_cosine(lanes x, lanes *sine, lanes *cosine)
{
    /* Taylor's series to the terms in r^15 and r^14. */
    static const double in_sine[] = {
        -7.647163731819816e-13, 1.6059043836821613e-10, -2.505210838544172e-08, 2.7557319223985893e-06,
        -0.0001984126984126984, 0.008333333333333333, -0.16666666666666666};
    static const double in_cosine[] = {
        -1.1470745597729725e-11, 2.08767569878681e-09, -2.755731922398589e-07, 2.48015873015873e-05,
        -0.001388888888888889, 0.041666666666666664, -0.5};
    const double magic = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to an integer in the lowest bits */
    lanes shifted = x * 0.63661977236758134308 + magic, k = shifted - magic;
    mask q = (mask)shifted & 3;
    lanes r = (x - k * 1.5707963267948966) - k * 6.123233995736766e-17, z = r * r, s = z - z, c = z - z;
    #pragma GCC unroll 7
    for (int n = 0; n < 7; n++) {
        s = z * (s + in_sine[n]);
        c = z * (c + in_cosine[n]);
    }
    s = r + r * s;
    c = 1 + c;
    mask odd = (q & 1) == 1, low = q >= 2, turned = (q == 1) | (q == 2);
    lanes a = choose(odd, c, s), b = choose(odd, s, c);
    *sine = choose(low, -a, a);
    *cosine = choose(turned, -b, b);
}

static inline lanes load(const double *from, long k, long n)
{
    lanes out;
    if (k + W <= n) memcpy(&out, from + k, sizeof out);
    else for (int l = 0; l < W; l++) out[l] = from[k + l < n ? k + l : n - 1];
    return out;
}

static inline void store(double *to, long k, long n, lanes x)
{
    if (k + W <= n) memcpy(to + k, &x, sizeof x);
    else for (int l = 0; l < W && k + l < n; l++) to[k + l] = x[l];
}

static inline void report(signed char *status, long k, long n, lanes worst, lanes side, double tol)
{
    mask bad = ~((worst < tol) & (side > 0));
    for (int l = 0; l < W && k + l < n; l++) status[k + l] = bad[l] != 0;
}

/* One lane, four unknowns (B and C), LU with partial pivoting. */
void newton_scalar(long n, const double *phi, const double *par, double *cx, double *cy, signed char *status)
{
    const double a = par[0], b2 = par[1] * par[1], c2 = par[2] * par[2], d = par[3], tol = par[8];
    for (long k = 0; k < n; k++) {
        double pin[2] = {a * cos(phi[k]), a * sin(phi[k])};
        double q[4] = {par[4], par[5], par[6], par[7]};
        int ok = 0;
        for (int it = 0; it <= MOST; it++) {
            double px = q[2] - q[0], py = q[3] - q[1], rx = q[2] - d, ry = q[3];
            double r[4] = {d * (q[0] - pin[0]), d * (q[1] - pin[1]), px * px + py * py - b2, rx * rx + ry * ry - c2};
            double J[4][4] = {{d, 0, 0, 0}, {0, d, 0, 0}, {-2 * px, -2 * py, 2 * px, 2 * py}, {0, 0, 2 * rx, 2 * ry}};
            double worst = 0;
            for (int i = 0; i < 4; i++) worst = fmax(worst, fabs(r[i]));
            if (worst < tol) { ok = 1; break; }
            for (int c = 0; c < 4; c++) {
                int p = c;
                for (int i = c + 1; i < 4; i++) if (fabs(J[i][c]) > fabs(J[p][c])) p = i;
                if (p != c) {
                    for (int j = 0; j < 4; j++) { double t = J[c][j]; J[c][j] = J[p][j]; J[p][j] = t; }
                    double t = r[c]; r[c] = r[p]; r[p] = t;
                }
                for (int i = c + 1; i < 4; i++) {
                    double f = J[i][c] / J[c][c];
                    for (int j = c; j < 4; j++) J[i][j] -= f * J[c][j];
                    r[i] -= f * r[c];
                }
            }
            for (int i = 3; i >= 0; i--) {
                for (int j = i + 1; j < 4; j++) r[i] -= J[i][j] * r[j];
                r[i] /= J[i][i];
            }
            for (int i = 0; i < 4; i++) q[i] -= r[i];
        }
        cx[k] = q[2];
        cy[k] = q[3];
        status[k] = !(ok && right_side(q[0], q[1], q[2], q[3], par));
    }
}

/* Eight lanes at a time, four unknowns, dense LU; rows are exchanged by comparing and selecting in every lane. */
void newton_simd4(long n, const double *phi, const double *par, double *cx, double *cy, signed char *status)
{
    const double a = par[0], b2 = par[1] * par[1], c2 = par[2] * par[2], d = par[3], tol = par[8];
    for (long k = 0; k < n; k += W) {
        lanes sine, cosine, q[4], r[4], J[4][4], worst, px, py, rx, none = {0};
        sine_cosine(load(phi, k, n), &sine, &cosine);
        #pragma GCC unroll 4
        for (int i = 0; i < 4; i++) q[i] = none + par[4 + i];
        for (int it = 0;; it++) {
            px = q[2] - q[0], py = q[3] - q[1], rx = q[2] - d;
            r[0] = d * (q[0] - a * cosine);
            r[1] = d * (q[1] - a * sine);
            r[2] = px * px + py * py - b2;
            r[3] = rx * rx + q[3] * q[3] - c2;
            worst = larger(larger(absolute(r[0]), absolute(r[1])), larger(absolute(r[2]), absolute(r[3])));
            if (it == MOST || !any_not_below(worst, tol)) break;
            J[0][0] = none + d, J[0][1] = none, J[0][2] = none, J[0][3] = none;
            J[1][0] = none, J[1][1] = none + d, J[1][2] = none, J[1][3] = none;
            J[2][0] = -2 * px, J[2][1] = -2 * py, J[2][2] = 2 * px, J[2][3] = 2 * py;
            J[3][0] = none, J[3][1] = none, J[3][2] = 2 * rx, J[3][3] = 2 * q[3];
            #pragma GCC unroll 4
            for (int c = 0; c < 4; c++) {
                #pragma GCC unroll 4
                for (int i = c + 1; i < 4 && c >= 2; i++) { /* the first two pivots are constants */
                    mask swap = absolute(J[i][c]) > absolute(J[c][c]);
                    #pragma GCC unroll 4
                    for (int j = c; j < 4; j++) {
                        lanes x = J[c][j], y = J[i][j];
                        J[c][j] = choose(swap, y, x);
                        J[i][j] = choose(swap, x, y);
                    }
                    lanes x = r[c], y = r[i];
                    r[c] = choose(swap, y, x);
                    r[i] = choose(swap, x, y);
                }
                J[c][c] = 1 / J[c][c];
                #pragma GCC unroll 4
                for (int i = c + 1; i < 4; i++) {
                    lanes f = J[i][c] * J[c][c];
                    #pragma GCC unroll 4
                    for (int j = c + 1; j < 4; j++) J[i][j] -= f * J[c][j];
                    r[i] -= f * r[c];
                }
            }
            #pragma GCC unroll 4
            for (int i = 3; i >= 0; i--) {
                #pragma GCC unroll 4
                for (int j = i + 1; j < 4; j++) r[i] -= J[i][j] * r[j];
                r[i] *= J[i][i];
            }
            #pragma GCC unroll 4
            for (int i = 0; i < 4; i++) q[i] -= r[i];
        }
        store(cx, k, n, q[2]);
        store(cy, k, n, q[3]);
        report(status, k, n, worst, par[9] * (px * q[3] - py * rx), tol);
    }
}

/* Eight lanes at a time, two unknowns (C): the crank pin follows from the angle. */
void newton_simd2(long n, const double *phi, const double *par, double *cx, double *cy, signed char *status)
{
    const double a = par[0], b2 = par[1] * par[1], c2 = par[2] * par[2], d = par[3], tol = par[8];
    for (long k = 0; k < n; k += W) {
        lanes sine, cosine, px, py, rx, f, g, worst, none = {0}, x = none + par[6], y = none + par[7];
        sine_cosine(load(phi, k, n), &sine, &cosine);
        for (int it = 0;; it++) {
            px = x - a * cosine, py = y - a * sine, rx = x - d;
            f = px * px + py * py - b2;
            g = rx * rx + y * y - c2;
            worst = larger(absolute(f), absolute(g));
            if (it == MOST || !any_not_below(worst, tol)) break;
            lanes inverse = 0.5 / (px * y - py * rx), ry = y;
            x -= (f * ry - g * py) * inverse;
            y -= (px * g - rx * f) * inverse;
        }
        store(cx, k, n, x);
        store(cy, k, n, y);
        report(status, k, n, worst, par[9] * (px * y - py * rx), tol);
    }
}

/* Closed form: two circles meet. */
void closed_form(long n, const double *phi, const double *par, double *cx, double *cy, signed char *status)
{
    const double a = par[0], b2 = par[1] * par[1], c2 = par[2] * par[2], d = par[3], side = par[9];
    for (long k = 0; k < n; k += W) {
        lanes sine, cosine, root;
        sine_cosine(load(phi, k, n), &sine, &cosine);
        lanes bx = a * cosine, by = a * sine, wx = d - bx, wy = -by, inverse = 1 / (wx * wx + wy * wy);
        lanes along = 0.5 * (1 + (b2 - c2) * inverse), square = b2 * inverse - along * along;
        for (int l = 0; l < W; l++) root[l] = sqrt(square[l] < 0 ? 0 : square[l]);
        lanes across = side * root;
        store(cx, k, n, bx + along * wx - across * wy);
        store(cy, k, n, by + along * wy + across * wx);
        report(status, k, n, square - square, square, 1);
    }
}
