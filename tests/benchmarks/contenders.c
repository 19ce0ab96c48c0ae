/* The ceiling: classical Runge-Kutta for many blocks at once, nothing that branches.

One sine a stage, since sin q - u cos q = sqrt(1 + u^2) sin(q - atan u), with the root and
the arctangent of the input once for each sample and all blocks. An impact flips side and
velocity at the end of its step, without rest and without uplift from it: the figures are
not to be believed, the time is that of the arithmetic alone.
*/
#include <math.h>

#define LANES 16

static inline double sine(double x)
{
    double z = x * x; /* odd Taylor polynomial: 1e-13 up to |x| = 1.6 */
    double sum = 1.0 / 355687428096000.0;
    sum = -1.0 / 1307674368000.0 + z * sum;
    sum = 1.0 / 6227020800.0 + z * sum;
    sum = -1.0 / 39916800.0 + z * sum;
    sum = 1.0 / 362880.0 + z * sum;
    sum = -1.0 / 5040.0 + z * sum;
    sum = 1.0 / 120.0 + z * sum;
    sum = -1.0 / 6.0 + z * sum;
    return x + x * z * sum;
}

/* root and shift: at the samples and halfway between them, 2 * steps + 1 in all */
void rock(int blocks, int steps, double h, const double *p, const double *ac,
          const double *restitution, const double *root, const double *shift, double *peaks)
{
#pragma omp parallel for schedule(static)
    for (int first = 0; first < blocks; first += LANES) {
        int count = blocks - first < LANES ? blocks - first : LANES;
        double x[LANES], v[LANES], s[LANES], c[LANES], a[LANES], g[LANES], peak[LANES];
        for (int i = 0; i < LANES; i++) {
            int j = first + (i < count ? i : 0);
            x[i] = v[i] = peak[i] = 0.0;
            s[i] = 1.0;
            c[i] = restitution[j];
            a[i] = ac[j];
            g[i] = -p[j] * p[j];
        }
        for (int n = 0; n < steps; n++) {
            const double *r = root + 2 * n, *d = shift + 2 * n;
#pragma omp simd
            for (int i = 0; i < LANES; i++) {
                double lean = a[i] * s[i];
                double k1 = g[i] * r[0] * sine(lean - x[i] - d[0]);
                double v2 = v[i] + h / 2 * k1;
                double k2 = g[i] * r[1] * sine(lean - (x[i] + h / 2 * v[i]) - d[1]);
                double v3 = v[i] + h / 2 * k2;
                double k3 = g[i] * r[1] * sine(lean - (x[i] + h / 2 * v2) - d[1]);
                double v4 = v[i] + h * k3;
                double k4 = g[i] * r[2] * sine(lean - (x[i] + h * v3) - d[2]);
                double xn = x[i] + h / 6 * (v[i] + 2 * (v2 + v3) + v4);
                double vn = v[i] + h / 6 * (k1 + 2 * (k2 + k3) + k4);
                double hit = s[i] * xn < 0.0 ? 1.0 : 0.0;
                /* a block past its top stays there, where the polynomial still holds */
                double inside = fabs(xn) < 1.5 ? 1.0 : 0.0;
                v[i] = inside * vn * (1.0 - hit * (1.0 - c[i]));
                s[i] = s[i] * (1.0 - 2.0 * hit);
                x[i] = inside * xn + (1.0 - inside) * x[i];
                peak[i] = fmax(peak[i], fabs(x[i]));
            }
        }
        for (int i = 0; i < count; i++)
            peaks[first + i] = peak[i];
    }
}
