// What a careful C++ programmer writes for the same three loops: vectors of loops in registers,
// sin ωt and cos ωt by rotation, exp and cos as polynomials; Runge-Kutta of order 4, and a Taylor
// step of fixed order. Used by the benchmark only.
// g++ -O3 -march=native -ffast-math -shared -fPIC -DREAL=double ensemble.cpp

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <new>
#include <limits>
#include <type_traits>

using Real = REAL;

// What is the same for all loops may still be another number in the next run, as in a kernel of ours:
// the compiler must not know it.
extern "C" {
Real SOURCE[2] = {-1, -1}, CURVATURE[2] = {1, Real(0.5)}, PEAK = 1;
Real DECAY = Real(0.1), WAVE = Real(0.5);
Real PUSH = Real(0.3), DIRECT = 5, FILTERED = Real(-12.5), POLE = -3;
}

namespace {

#ifdef __AVX512F__
constexpr int BYTES = 64;
#else
constexpr int BYTES = 32;
#endif
constexpr int WIDTH = BYTES / sizeof(Real);
constexpr int COLUMNS = 8;
constexpr int BLOCK = 8;  // steps between two fresh starts of the rotation
typedef Real V __attribute__((vector_size(BYTES)));
typedef std::conditional_t<sizeof(Real) == 8, std::int64_t, std::int32_t> Whole;
typedef Whole I __attribute__((vector_size(BYTES)));

// --- exp, sin and cos on |x| < 2^20 -------------------------------------------------------------

constexpr int TERMS = sizeof(Real) == 8 ? 11 : 6;
constexpr int MANTISSA = sizeof(Real) == 8 ? 52 : 23;
constexpr Real SHIFT = Real(4096);

inline I nearest(V x) {  // conversion truncates: shifted, it rounds
    return __builtin_convertvector(x + (SHIFT + Real(0.5)), I) - Whole(SHIFT);
}

inline V exponential(V x) {
    const Real lowest = Real(sizeof(Real) == 8 ? -700 : -85);
    x = x < lowest ? V{} + lowest : x;
    const I n = nearest(x * Real(1.4426950408889634));
    const V r = x - __builtin_convertvector(n, V) * Real(0.6931471805599453);
    V sum = V{} + Real(1);
#pragma GCC unroll 16
    for (int k = TERMS; k > 0; k--) sum = sum * r * (Real(1) / Real(k)) + Real(1);
    return (V)((I)sum + (n << MANTISSA));
}

inline void turned(V x, V& sine, V& cosine) {  // x = nπ + r
    const I n = nearest(x * Real(0.3183098861837907));
    const V r = x - __builtin_convertvector(n, V) * Real(3.141592653589793), z = r * r;
    V even = V{} + Real(1), odd = even;
#pragma GCC unroll 16
    for (int k = TERMS; k > 0; k--) {
        even = Real(1) - even * z * (Real(1) / Real((2 * k - 1) * 2 * k));
        odd = Real(1) - odd * z * (Real(1) / Real(2 * k * (2 * k + 1)));
    }
    const I sign = n << (8 * sizeof(Real) - 1);
    cosine = (V)((I)even ^ sign);
    sine = (V)((I)(odd * r) ^ sign);
}

// --- the loops: start, rates, and the Taylor coefficients k + 1 from those up to k --------------

struct Lane {
    V start[2], alpha[2], gain[2], omega, washout;  // the columns, in their order
};

template <int P>
struct Series {
    V at[P + 1];
    V& operator[](int k) { return at[k]; }
};

template <int P>
inline V product(Series<P>& a, Series<P>& b, int k) {
    V sum = a[0] * b[k];
#pragma GCC unroll 32
    for (int j = 1; j <= k; j++) sum += a[j] * b[k - j];
    return sum;
}

template <int P>
inline V square(Series<P>& a, int k) {
    if (k == 0) return a[0] * a[0];
    V sum = a[0] * a[k];
#pragma GCC unroll 32
    for (int j = 1; j <= (k - 1) / 2; j++) sum += a[j] * a[k - j];
    sum += sum;
    return k % 2 ? sum : sum + a[k / 2] * a[k / 2];
}

// Series in τ/h of sin(ω(t + τ)) and cos(ω(t + τ)), and of ξ times them.
template <int P>
struct Waves {
    V s, c;          // sin ωt, cos ωt
    const V* weight;  // ±(ωh)^k / k!, the signs of the series: + + − − + …
    V sine(int k) const { return weight[k] * (k % 2 ? c : s); }
    V cosine(int k) const { return weight[k] * (k % 2 ? -s : c); }
    void times(Series<P>& xi, int k, V& by_sine, V& by_cosine) const {
        V even = xi[k] * weight[0], odd = V{};  // one sum serves both
#pragma GCC unroll 32
        for (int j = 2; j <= k; j += 2) even += weight[j] * xi[k - j];
#pragma GCC unroll 32
        for (int j = 1; j <= k; j += 2) odd += weight[j] * xi[k - j];
        by_sine = s * even + c * odd;
        by_cosine = c * even - s * odd;
    }
};

struct Quadratic {
    static V signal(V x, V y) {
        const V u = x - SOURCE[0], v = y - SOURCE[1];
        return PEAK - CURVATURE[0] * u * u - CURVATURE[1] * v * v;
    }
    template <int P>
    struct Signal {
        Series<P> u, v;
        V operator()(Series<P>& x, Series<P>& y, int k) {
            u[k] = k ? x[k] : x[k] - SOURCE[0];
            v[k] = k ? y[k] : y[k] - SOURCE[1];
            const V sum = -CURVATURE[0] * square(u, k) - CURVATURE[1] * square(v, k);
            return k ? sum : sum + PEAK;
        }
    };
};

struct Wavy {
    static V signal(V x, V y) {
        V sine, cosine;
        turned(WAVE * x, sine, cosine);
        return exponential(-DECAY * (x * x + y * y)) * cosine;
    }
    template <int P>
    struct Signal {  // E' = g' E; S' = g' C, C' = −g' S with the coefficients of tg' kept
        Series<P> e, s, c, slope, turn;
        V operator()(Series<P>& x, Series<P>& y, int k) {
            const V g = -DECAY * (square(x, k) + square(y, k));
            if (k == 0) {
                e[0] = exponential(g);
                turned(WAVE * x[0], s[0], c[0]);
                return e[0] * c[0];
            }
            slope[k] = g * Real(k);
            turn[k] = x[k] * (WAVE * Real(k));
            V sums[3] = {slope[1] * e[k - 1], turn[1] * c[k - 1], turn[1] * s[k - 1]};
#pragma GCC unroll 32
            for (int j = 2; j <= k; j++) {
                sums[0] += slope[j] * e[k - j];
                sums[1] += turn[j] * c[k - j];
                sums[2] += turn[j] * s[k - j];
            }
            e[k] = sums[0] * (Real(1) / Real(k));
            s[k] = sums[1] * (Real(1) / Real(k));
            c[k] = sums[2] * (Real(-1) / Real(k));
            return product(e, c, k);
        }
    };
};

template <class Map>
struct Velocity {  // x, y, η
    static constexpr int STATES = 3, ORDER = 8;  // the fastest at an error of 1e-6
    static void start(const Lane& p, V* x) {
        x[0] = p.start[0], x[1] = p.start[1], x[2] = V{};
    }
    static void rates(const Lane& p, const V* x, V s, V c, V* slope) {
        const V xi = Map::signal(x[0], x[1]) - x[2];
        slope[0] = p.alpha[0] * p.omega * c + p.gain[0] * xi * s;
        slope[1] = p.alpha[1] * p.omega * s - p.gain[1] * xi * c;
        slope[2] = p.washout * xi;
    }
    template <int P>
    struct Rates {
        typename Map::template Signal<P> map;
        Series<P> xi;
        void operator()(const Lane& p, Series<P>* x, const Waves<P>& waves, Real h, int k) {
            V by_sine, by_cosine;
            xi[k] = map(x[0], x[1], k) - x[2][k];
            waves.times(xi, k, by_sine, by_cosine);
            const Real part = h / Real(k + 1);
            x[0][k + 1] = p.alpha[0] * waves.sine(k + 1) + p.gain[0] * part * by_sine;
            x[1][k + 1] = -p.alpha[1] * waves.cosine(k + 1) - p.gain[1] * part * by_cosine;
            x[2][k + 1] = p.washout * part * xi[k];
        }
    };
};

struct Force {  // x, v_x, y, v_y, η, ζ_x, ζ_y
    static constexpr int STATES = 7, ORDER = 10;
    static void start(const Lane& p, V* x) {
        x[0] = p.start[0], x[1] = p.alpha[0] * p.omega, x[2] = p.start[1];
        x[3] = x[5] = x[6] = V{};
        x[4] = Quadratic::signal(x[0], x[2]);
    }
    static void rates(const Lane& p, const V* x, V s, V c, V* slope) {
        const V xi = Quadratic::signal(x[0], x[2]) - x[4], square = p.omega * p.omega;
        const V m_x = p.gain[0] * xi * s, m_y = -p.gain[1] * xi * c;
        slope[0] = x[1];
        slope[1] = PUSH - p.alpha[0] * square * s + x[5] + DIRECT * m_x;
        slope[2] = x[3];
        slope[3] = p.alpha[1] * square * c + x[6] + DIRECT * m_y;
        slope[4] = p.washout * xi;
        slope[5] = POLE * x[5] + FILTERED * m_x;
        slope[6] = POLE * x[6] + FILTERED * m_y;
    }
    template <int P>
    struct Rates {
        Quadratic::Signal<P> map;
        Series<P> xi;
        void operator()(const Lane& p, Series<P>* x, const Waves<P>& waves, Real h, int k) {
            V m_x, m_y;
            xi[k] = map(x[0], x[2], k) - x[4][k];
            waves.times(xi, k, m_x, m_y);
            m_x *= p.gain[0], m_y *= -p.gain[1];
            const Real part = h / Real(k + 1), push = k ? Real(0) : PUSH;
            x[0][k + 1] = part * x[1][k];
            x[1][k + 1] = p.alpha[0] * p.omega * waves.cosine(k + 1) +
                          part * (push + x[5][k] + DIRECT * m_x);
            x[2][k + 1] = part * x[3][k];
            x[3][k + 1] = p.alpha[1] * p.omega * waves.sine(k + 1) +
                          part * (x[6][k] + DIRECT * m_y);
            x[4][k + 1] = p.washout * part * xi[k];
            x[5][k + 1] = part * (POLE * x[5][k] + FILTERED * m_x);
            x[6][k + 1] = part * (POLE * x[6][k] + FILTERED * m_y);
        }
    };
};

// --- steps: part after part, the vectors of a group by turns, so that none waits for itself -------

template <class Loop>
struct RungeKutta {
    static constexpr int PARTS = 4, TURNS = 2, N = Loop::STATES;  // rotations a step
    Real h;
    V sum[N], mid[N];
    RungeKutta(const Lane&, Real step) : h(step) {}
    inline __attribute__((always_inline)) void part(
        int k, const Lane& p, V* x, V& s, V& c, V sine, V cosine) {
        V slope[N];
        if (k == 1 || k == 3) {
            const V before = s;
            s = s * cosine + c * sine, c = c * cosine - before * sine;
        }
        Loop::rates(p, k ? mid : x, s, c, slope);
        for (int i = 0; i < N; i++) {
            sum[i] = k == 0 ? slope[i] : sum[i] + (k == 3 ? Real(1) : Real(2)) * slope[i];
            if (k < 3) mid[i] = x[i] + (k == 2 ? h : h / 2) * slope[i];
            if (k == 3) x[i] += h / 6 * sum[i];
        }
    }
};

template <class Loop>
struct Taylor {
    static constexpr int ORDER = Loop::ORDER, PARTS = ORDER, TURNS = 1, N = Loop::STATES;
    Real h;
    V weight[ORDER + 1];
    Series<ORDER> state[N];
    typename Loop::template Rates<ORDER> rates;
    Taylor(const Lane& p, Real step) : h(step) {
        weight[0] = V{} + Real(1);
        for (int k = 1; k <= ORDER; k++)
            weight[k] = weight[k - 1] * (p.omega * h) / Real(k % 2 ? k : -k);
    }
    inline __attribute__((always_inline)) void part(
        int k, const Lane& p, V* x, V& s, V& c, V sine, V cosine) {
        const Waves<ORDER> waves{s, c, weight};
        if (k == 0)
            for (int i = 0; i < N; i++) state[i][0] = x[i];
        rates(p, state, waves, h, k);
        for (int i = 0; i < N; i++) x[i] += state[i][k + 1];
        if (k < ORDER - 1) return;
        const V before = s;
        s = s * cosine + c * sine, c = c * cosine - before * sine;
    }
};

// --- which loops have escaped: on the bits, as -ffast-math believes in no NaN --------------------

inline void watched(const V* x, int states, V now, V& alive) {
    const Whole size = std::numeric_limits<Whole>::max();
    const V limit = V{} + Real(sizeof(Real) == 8 ? 1e100 : 1e18);
    I inside = I{} - 1;
    for (int i = 0; i < states; i++) inside &= ((I)x[i] & size) < (I)limit;
    alive = inside ? now : alive;
}

// --- all loops ------------------------------------------------------------------------------------

struct Rotation {  // in double precision; each block of steps begins with its sine and cosine
    double sine[WIDTH], cosine[WIDTH], s[WIDTH], c[WIDTH];
    void block(V& to_s, V& to_c) {
        for (int l = 0; l < WIDTH; l++) {
            to_s[l] = Real(s[l]), to_c[l] = Real(c[l]);
            const double before = s[l];
            s[l] = before * cosine[l] + c[l] * sine[l];
            c[l] = c[l] * cosine[l] - before * sine[l];
        }
    }
};

template <class Loop, template <class> class Step, int GROUP, int OUTER>
void integrate(const double* columns, Real* states, long loops, long steps, double t_end) {
    constexpr int N = Loop::STATES;
    const double h = t_end / double(steps);
    for (long first = 0; first < loops; first += GROUP * WIDTH) {
        Lane lanes[GROUP];
        V alive[GROUP] = {}, x[GROUP][N], s[GROUP], c[GROUP], sine[GROUP], cosine[GROUP];
        Rotation rotations[GROUP];
        alignas(64) unsigned char memory[GROUP][sizeof(Step<Loop>)];
        Step<Loop>* step[GROUP];
        for (int u = 0; u < GROUP; u++) {
            V* to = reinterpret_cast<V*>(&lanes[u]);
            for (int l = 0; l < WIDTH; l++) {
                const long loop = std::min(first + u * WIDTH + l, loops - 1);
                for (int k = 0; k < COLUMNS; k++) to[k][l] = Real(columns[k * loops + loop]);
                const double turn = columns[6 * loops + loop] * h, angle = turn / Step<Loop>::TURNS;
                sine[u][l] = Real(std::sin(angle)), cosine[u][l] = Real(std::cos(angle));
                Rotation& r = rotations[u];
                r.sine[l] = std::sin(turn * BLOCK), r.cosine[l] = std::cos(turn * BLOCK);
                r.s[l] = 0, r.c[l] = 1;
            }
            Loop::start(lanes[u], x[u]);
            step[u] = new (memory[u]) Step<Loop>(lanes[u], Real(h));
        }
        for (long begin = 0; begin < steps; begin += BLOCK) {
            for (int u = 0; u < GROUP; u++) watched(x[u], N, V{} + Real(begin), alive[u]);
            for (int u = 0; u < GROUP; u++) rotations[u].block(s[u], c[u]);
            const long end = std::min(begin + BLOCK, steps);
            for (long i = begin; i < end; i++)
#pragma GCC unroll 8
                for (int o = 0; o < OUTER; o++)
#pragma GCC unroll 32
                    for (int k = 0; k < Step<Loop>::PARTS; k++)
#pragma GCC unroll 8
                        for (int u = o; u < GROUP; u += OUTER)
                            step[u]->part(k, lanes[u], x[u], s[u], c[u], sine[u], cosine[u]);
        }
        for (int u = 0; u < GROUP; u++)
            for (int i = 0; i < N; i++)
                for (int l = 0; l < WIDTH && first + u * WIDTH + l < loops; l++)
                    states[i * loops + first + u * WIDTH + l] = x[u][i][l];
        for (int u = 0; u < GROUP; u++)
            for (int l = 0; l < WIDTH && first + u * WIDTH + l < loops; l++)
                states[N * loops + first + u * WIDTH + l] = alive[u][l] * Real(h);
    }
}

}  // namespace

#define EXPORT(name, Loop, Step, ...)                                                        \
    extern "C" void name(const double* columns, Real* states, long loops, long steps, double end) { \
        integrate<Loop, Step, __VA_ARGS__>(columns, states, loops, steps, end);                     \
    }

EXPORT(quadratic_rk4, Velocity<Quadratic>, RungeKutta, 6, 1)
EXPORT(force_rk4, Force, RungeKutta, 2, 2)
EXPORT(wavy_rk4, Velocity<Wavy>, RungeKutta, 6, 1)
EXPORT(quadratic_taylor, Velocity<Quadratic>, Taylor, 4, 1)
EXPORT(force_taylor, Force, Taylor, 2, 2)
EXPORT(wavy_taylor, Velocity<Wavy>, Taylor, 2, 1)
