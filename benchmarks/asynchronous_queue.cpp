// Continuous agents behind a slow and lossy channel, with one binary heap of single events.
//
// As a good C++ programmer would write it: an agent's numbers for one resource lie together, its costs
// are dense polynomials by Horner's scheme, and the total is carried along, so that a look at it costs
// nothing.  Compiled with -O3 -march=native, and with TERMS, the number of terms of a derivative.

#include <cmath>
#include <cstdint>
#include <queue>
#include <vector>

namespace {

// xoshiro256+ by D. Blackman and S. Vigna, seeded with splitmix64.
struct Luck {
    std::uint64_t s[4];

    explicit Luck(std::uint64_t seed) {
        for (auto &word : s) {
            std::uint64_t z = (seed += 0x9e3779b97f4a7c15ULL);
            z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
            z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
            word = z ^ (z >> 31);
        }
    }

    double uniform() {
        const std::uint64_t result = s[0] + s[3], t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = (s[3] << 45) | (s[3] >> 19);
        return static_cast<double>(result >> 11) * 0x1p-53;
    }
};

// What an agent holds of one resource: when it last answered, since when, and the integral up to then.
struct Holding {
    double held, since, area, increase, decrease;
    double slopes[TERMS];
};

// An agent of -1 is a look of the control unit.
struct Event {
    double time;
    std::int32_t agent, resource;

    bool operator<(const Event &other) const { return time > other.time; }
};

// Nearer than this to the threshold is there: a wait so short might not move the clock at all.
constexpr double soon = 1e-9;

}  // namespace

// Tables of agents by resources: increase, decrease, averages (n, m); slopes (n, m, TERMS), lowest power first.
extern "C" void run(std::int64_t n, std::int64_t m, double until, double latency, double loss,
                    double hold_off, std::uint64_t seed, const double *increase, const double *decrease,
                    const double *normalization, const double *limit, const double *slopes,
                    std::int64_t *signals, double *averages, std::int64_t *deliveries) {
    Luck luck(seed);
    std::vector<Holding> holdings(n * m);
    std::vector<double> slope(m, 0.0), total(m, 0.0), summed(m, 0.0);
    std::priority_queue<Event> events;
    for (std::int64_t own = 0; own < n * m; ++own) {
        Holding &holding = holdings[own];
        holding = Holding{0.0, 0.0, 0.0, increase[own], decrease[own], {}};
        for (int d = 0; d < TERMS; ++d) holding.slopes[d] = slopes[own * TERMS + d];
        slope[own % m] += increase[own];
    }
    for (std::int64_t j = 0; j < m; ++j) {
        signals[j] = 0;
        events.push({limit[j] / slope[j], -1, static_cast<std::int32_t>(j)});
    }
    *deliveries = 0;
    while (events.top().time < until) {  // there is always a look of each resource
        const Event event = events.top();
        events.pop();
        const double now = event.time;
        const std::int64_t j = event.resource;
        if (event.agent < 0) {
            total[j] += slope[j] * (now - summed[j]);
            summed[j] = now;
            const double wait = (limit[j] - total[j]) / slope[j];
            if (wait > soon) {  // responses only lower the total, so it cannot get there earlier
                events.push({now + wait, -1, event.resource});
                continue;
            }
            ++signals[j];
            for (std::int32_t i = 0; i < n; ++i) {
                if (luck.uniform() >= loss) {
                    events.push({now - latency * std::log(1.0 - luck.uniform()), i, event.resource});
                }
            }
            events.push({now + hold_off, -1, event.resource});
            continue;
        }
        ++*deliveries;
        Holding &holding = holdings[event.agent * m + j];
        const double passed = now - holding.since;
        const double demand = holding.held + holding.increase * passed;
        holding.area += passed * (holding.held + demand) / 2;
        holding.since = now;
        const double average = holding.area / now;
        double gradient = holding.slopes[TERMS - 1];
        for (int d = TERMS - 2; d >= 0; --d) gradient = gradient * average + holding.slopes[d];
        const bool responds = luck.uniform() < normalization[j] * gradient / average;
        holding.held = responds ? holding.decrease * demand : demand;
        total[j] += holding.held - demand;
    }
    for (std::int64_t own = 0; own < n * m; ++own) {
        const Holding &holding = holdings[own];
        const double passed = until - holding.since;
        const double demand = holding.held + holding.increase * passed;
        averages[own] = (holding.area + passed * (holding.held + demand) / 2) / until;
    }
}
