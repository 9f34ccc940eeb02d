/* The discrete-step algorithm as a plain C loop: every step, every resource, every agent in turn.
 *
 * Tables are [resource][agent]; slopes are [resource][agent][term], lowest power first.
 * `demand`, `average` and `signals` come in as zeros and go out as x(K), the average over x(0)..x(K)
 * and the number of capacity events.
 */
#include <stdbool.h>
#include <stdint.h>

typedef struct {
    uint64_t s[4];
} generator;

static generator seeded(uint64_t seed) /* splitmix64, as the authors of xoshiro advise */
{
    generator g;
    for (int w = 0; w < 4; w++) {
        uint64_t z = (seed += 0x9e3779b97f4a7c15u);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        g.s[w] = z ^ (z >> 31);
    }
    return g;
}

static double uniform(generator *g) /* xoshiro256+, in [0, 1) */
{
    uint64_t *s = g->s, sum = s[0] + s[3], shifted = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= shifted;
    s[3] = (s[3] << 45) | (s[3] >> 19);
    return (double)(sum >> 11) * 0x1p-53;
}

static double derivative(const double *slopes, int terms, double x)
{
    double value = 0.0;
    for (int d = terms - 1; d >= 0; d--)
        value = value * x + slopes[d];
    return value;
}

void run(int agents, int resources, int terms, int64_t steps, uint64_t seed, const double *limit,
         const double *normalization, const double *increase, const double *decrease,
         const double *slopes, double *demand, double *average, int64_t *signals)
{
    generator g = seeded(seed);
    bool signal[resources];
    for (int j = 0; j < resources; j++)
        signal[j] = false;

    for (int64_t k = 0; k < steps; k++) {
        double keep = (k + 1.0) / (k + 2.0), fold = 1.0 / (k + 2.0);
        for (int j = 0; j < resources; j++) {
            double *x = demand + j * agents, *mean = average + j * agents;
            const double *alpha = increase + j * agents, *beta = decrease + j * agents;
            const double *slope = slopes + j * agents * terms;

            double total = 0.0;
            for (int i = 0; i < agents; i++)
                total += x[i];

            if (signal[j]) {
                for (int i = 0; i < agents; i++) {
                    double lambda = normalization[j] * derivative(slope + i * terms, terms, mean[i]) / mean[i];
                    if (uniform(&g) < lambda)
                        x[i] *= beta[i];
                }
            } else {
                for (int i = 0; i < agents; i++)
                    x[i] += alpha[i];
            }
            for (int i = 0; i < agents; i++)
                mean[i] = keep * mean[i] + fold * x[i];

            signal[j] = total > limit[j]; /* S(k+1), from x(k) */
            signals[j] += signal[j];
        }
    }
}
