/* The same algorithm in a form that a compiler can vectorise across agents: the yardstick.
 *
 * What differs from discrete.c: a generator per agent in place of one for all; no branch inside a loop
 * over agents; the total is added up in the pass that moves the demand, in whatever order the compiler
 * likes; u * mean < Gamma * grad in place of a division; the number of terms is known to the compiler.
 * Tables are [resource][agent]; slopes are [term][resource][agent], so that neighbours are neighbours.
 * The caller fills rows up to whole vectors with agents that hold nothing, and aligns what it hands over.
 */
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

static uint64_t splitmix64(uint64_t *state)
{
    uint64_t z = (*state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static double grow(int agents, double keep, double fold, const double *alpha, double *x, double *mean)
{
    double total = 0.0;
#pragma omp simd reduction(+ : total)
    for (int i = 0; i < agents; i++) {
        total += x[i];
        x[i] += alpha[i];
        mean[i] = keep * mean[i] + fold * x[i];
    }
    return total;
}

static double respond(int agents, int table, double keep, double fold, double gamma, const double *beta,
                      const double *slopes, double *x, double *mean, uint64_t *s0, uint64_t *s1, uint64_t *s2,
                      uint64_t *s3)
{
    double total = 0.0;
#pragma omp simd reduction(+ : total)
    for (int i = 0; i < agents; i++) {
        uint64_t sum = s0[i] + s3[i], shifted = s1[i] << 17; /* xoshiro256+ */
        s2[i] ^= s0[i];
        s3[i] ^= s1[i];
        s1[i] ^= s2[i];
        s0[i] ^= s3[i];
        s2[i] ^= shifted;
        s3[i] = (s3[i] << 45) | (s3[i] >> 19);
        double u = (double)(int64_t)(sum >> 11) * 0x1p-53;

        double gradient = 0.0;
        for (int d = TERMS - 1; d >= 0; d--)
            gradient = gradient * mean[i] + slopes[d * table + i];

        total += x[i];
        x[i] *= u * mean[i] < gamma * gradient ? beta[i] : 1.0;
        mean[i] = keep * mean[i] + fold * x[i];
    }
    return total;
}

void run(int agents, int resources, int terms, int64_t steps, uint64_t seed, const double *limit,
         const double *normalization, const double *increase, const double *decrease,
         const double *slopes, double *demand, double *average, int64_t *signals)
{
    (void)terms; /* TERMS, given to the compiler */
    uint64_t *state = aligned_alloc(64, 4 * sizeof *state * agents); /* whole vectors */
    for (int word = 0; word < 4 * agents; word++)
        state[word] = splitmix64(&seed);
    bool signal[resources];
    for (int j = 0; j < resources; j++)
        signal[j] = false;

    for (int64_t k = 0; k < steps; k++) {
        double keep = (k + 1.0) / (k + 2.0), fold = 1.0 / (k + 2.0), total;
        for (int j = 0; j < resources; j++) {
            int at = j * agents;
            if (signal[j])
                total = respond(agents, resources * agents, keep, fold, normalization[j], decrease + at,
                                slopes + at, demand + at, average + at, state, state + agents,
                                state + 2 * agents, state + 3 * agents);
            else
                total = grow(agents, keep, fold, increase + at, demand + at, average + at);
            signal[j] = total > limit[j]; /* S(k+1), from x(k) */
            signals[j] += signal[j];
        }
    }
    free(state);
}
