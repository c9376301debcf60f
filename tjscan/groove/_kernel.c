/* Loops over a profile's points, compiled: what groove/ does with NumPy otherwise.

   Each function has a twin in Python of the same name or of the name in its comment, whose docstring
   says what it does and why; both give the same to rounding (tests/groove/test_kernel.py). Constants
   have the names and values that they have there. Arrays are contiguous; lengths are in metres. */

#define Py_LIMITED_API 0x030B0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define KERNEL_VERSION 7
#define OUTLIER_SIGMAS 3.3
#define LEAST_NOISE 4e-6
#define SCALING_LENGTH 0.02
#define FIXED_WEIGHT 1e12
#define STEEPEST_SLOPE 1.5
#define _FARTHEST_CORNER_DISTANCE 1.0
#define _PARALLEL_SINE 1e-3
#define _SETTLED_NEWTON_STEP 1e-10
#define LONGEST_LAG 24
#define WIDEST_HALF_LAG (LONGEST_LAG / 2 * 0.83)
#define LARGEST_NOISE_SHARE_IN_FIT 0.6
#define CORRELATION_POWER 1.6
#define _LEAST_CORRELATION 0.01
#define _SHORTEST_LAG 0.15
#define GHOST_SIGMAS 0.7
#define FEWEST_POINTS_OF_GHOST 3
#define FEWEST_SIDE_POINTS 3
#define POOLED_NOISE_POINTS 20
#define OUTER_SIDE_REACH 3.0
#define SETTLED_SIGMAS 1.0
#define SAME_FIT_DISTANCE 0.05e-3
#define MOST_REFINEMENT_ROUNDS 10
#define ROUNDS_BEFORE_CURVATURE_CHOICE 3
#define REBASED_ROUNDS 4
#define STRAIGHT_LOG_ODDS 1.1
#define RIM_POINTS 8
#define LARGEST_CURL 0.6e-3
#define LEAST_CURL_SIGMAS 2.5
#define FEWEST_CURLED_RIMS 2
#define _MAD_TO_SIGMA 1.4826
#define _GUESSED_VARIANCE_INFLATION 4.0
#define FACE_BLUNTNESS 0.2
#define LEAST_COLUMNS_OF_HOLE 6
#define SCALE_COVERED_SHARE 0.35
#define STRAY_BLOCK_COST 9.0
#define FARTHEST_POINT_RATIO 4.0
#define MEETING_REACH 1.5e-3
#define LEAST_RAY_SINE 0.2
#define SUPPORT_NEIGHBOURS 4
#define PATCH_REACH 0.6e-3
#define FEWEST_PATCH_POINTS 12
#define CORNER_POINTS 3
#define ROUGH_SIDE_FACTOR 1.6
#define PATCH_SIGMAS 3.5
#define PATCHED_SHARE 0.15
#define UNSEEN_SIDE_SLOPE 0.04
#define PULL_PROBABILITY 0.5
#define FACE_END_SHARE 0.1
#define PULL_PRIOR_ODDS 0.5
#define PULL_SHAPE_SIGMA 0.1
#define NOTCH_REGION_LENGTH 8e-3
#define FEWEST_FACE_POINTS 8
#define LEAST_TURN_SINE 0.15
#define JUMP_DISTANCE 0.5e-3
#define JUMP_STEEPNESS 1.5
#define RUN_COST 3.0
#define POINT_COST 0.35
#define POINTS_PER_BLOCK 3
#define MOST_BLOCKS 220
#define LONGEST_PIECE_BLOCKS 48
#define FEWEST_RUN_POINTS 3
#define LEAST_BEARING_SPREAD 1e-6
#define PIECE_COST 7.0
#define NOISE_INFLATION 2.0
#define LEAST_UNEVENNESS 0.01e-3
#define QUIET_QUANTILE 0.25
#define LEAST_DIFFERENCE 1e-8
#define QUIET_QUANTILE_OF_NORMAL 0.3186
#define MOST_CANDIDATES 48
#define MOST_RANGE_PIECES 48
#define MOST_GROWTH_ROUNDS 8
#define CONTINUING_SIGMAS 2.8
#define SURE_PREDICTION 0.12e-3
#define LIKELY_PREDICTION 0.5e-3
#define ROUGH_REACH_SIGMAS 2.0
#define LEAST_PIVOT 1e-18
#define BEAD_KIND 2
#define WELD_KIND 3
#define WELD_ROUGHNESS 0.5e-3
#define LEAST_FACE_TURN 0.2617993877991494
#define FEWEST_INNER_POINTS 2.8
#define FEWEST_OUTER_POINTS 8
#define LEAST_SUPPORT_SHARE 0.12
#define LEAST_DISTANCE_OF_RIVALS 1e-3
#define MOST_CHAINS_COMPARED 150
#define RIVAL_COST_MARGIN 12.0
#define CORNER_DISTANCE_BEYOND_POINTS 30e-3
#define SIDE_LENGTH_SLACK 0.8
#define WIDER_TOLERANCE_COST 0.3

/* Not constants of Python: sizes. */
enum { MOST_SIDES = 8, SIDE_VALUES = 8, MODEL_VALUES = 6 };

static double larger(double a, double b) { return a > b ? a : b; }
static double smaller(double a, double b) { return a < b ? a : b; }

/* ---- arrays that Python hands over ---- */

/* Opens arrays by a letter each: d double, i int64, b bool; capital if it is written to. */
static int open_arrays(const char *kinds, PyObject *const *objects, Py_buffer *views)
{
    for (int i = 0; kinds[i]; i++) {
        const char kind = kinds[i] | 32;
        const int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (kinds[i] == kind ? 0 : PyBUF_WRITABLE);
        const Py_ssize_t size = kind == 'b' ? 1 : 8;
        const char *formats = kind == 'd' ? "d" : kind == 'i' ? "lq" : "?Bb";
        if (PyObject_GetBuffer(objects[i], &views[i], flags) < 0) {
            while (i--) PyBuffer_Release(&views[i]);
            return -1;
        }
        if (views[i].itemsize != size || !views[i].format || !strchr(formats, views[i].format[0])) {
            PyErr_Format(PyExc_TypeError, "array %d is not of kind '%c'", i, kind);
            do PyBuffer_Release(&views[i]);
            while (i--);
            return -1;
        }
    }
    return 0;
}

static void close_arrays(const char *kinds, Py_buffer *views)
{
    for (size_t i = 0; i < strlen(kinds); i++) PyBuffer_Release(&views[i]);
}

static Py_ssize_t count_of(const Py_buffer *view) { return view->len / view->itemsize; }

/* ---- curves over chords: groove/sides.py ---- */

typedef struct {
    double cx, cz, tx, tz, c0, c1, c2, c3;
} Curve;

static double curve_height(const Curve *c, double s)
{
    return c->c0 + s * (c->c1 + s * (c->c2 + s * c->c3));
}

static double curve_slope(const Curve *c, double s)
{
    return c->c1 + s * (2 * c->c2 + 3 * s * c->c3);
}

static void point_on_curve(const Curve *c, double s, double *x, double *z)
{
    const double q = curve_height(c, s);
    *x = c->cx + s * c->tx + q * c->tz;
    *z = c->cz + s * c->tz - q * c->tx;
}

static double position_along_chord(const Curve *c, double x, double z)
{
    return (x - c->cx) * c->tx + (z - c->cz) * c->tz;
}

static Curve rebased_at_tangent(const Curve *c, double s)
{
    const double slope = curve_slope(c, s), square = 1 + slope * slope, scale = 1 / sqrt(square);
    Curve r;
    point_on_curve(c, s, &r.cx, &r.cz);
    r.tx = (c->tx + slope * c->tz) * scale;
    r.tz = (c->tz - slope * c->tx) * scale;
    r.c0 = r.c1 = 0.0;
    r.c2 = (c->c2 + 3 * s * c->c3) / (square * sqrt(square));
    r.c3 = c->c3;
    return r;
}

/* s on a and on b where they meet near a start; 0 if they do not. */
static int intersect_curves(const Curve *a, const Curve *b, double start, double met[2])
{
    const double rx = a->cx - b->cx, rz = a->cz - b->cz;
    const double along = rx * b->tx + rz * b->tz, away = rx * b->tz - rz * b->tx;
    const double cosine = a->tx * b->tx + a->tz * b->tz, sine = a->tx * b->tz - a->tz * b->tx;
    double s = start, dq = 0.0, dqb = 0.0;
    int settled = 0;
    for (int round = 0; round < 12 && !settled; round++) {
        const double q = curve_height(a, s), sb = along + s * cosine - q * sine;
        dq = curve_slope(a, s);
        const double qb = curve_height(b, sb);
        dqb = curve_slope(b, sb);
        const double slope = sine + dq * cosine - dqb * (cosine - dq * sine);
        if (fabs(slope) < _PARALLEL_SINE) return 0;
        const double step = (away + s * sine + q * cosine - qb) / slope;
        s -= step;
        settled = fabs(step) < _SETTLED_NEWTON_STEP;
    }
    if (!settled || !(fabs(s) < _FARTHEST_CORNER_DISTANCE) || fabs(dq) > STEEPEST_SLOPE || fabs(dqb) > STEEPEST_SLOPE)
        return 0;
    met[0] = s;
    met[1] = along + s * cosine - curve_height(a, s) * sine;
    return 1;
}

/* ---- small linear algebra ---- */

/* Inverse of a 4 by 4 matrix; 0 if it is singular. */
static int invert(const double given[16], double inverse[16])
{
    double m[4][8];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            m[i][j] = given[4 * i + j];
            m[i][4 + j] = i == j;
        }
    for (int c = 0; c < 4; c++) {
        int pivot = c;
        for (int i = c + 1; i < 4; i++)
            if (fabs(m[i][c]) > fabs(m[pivot][c])) pivot = i;
        if (m[pivot][c] == 0.0) return 0;
        if (pivot != c)
            for (int j = 0; j < 8; j++) {
                const double kept = m[c][j];
                m[c][j] = m[pivot][j];
                m[pivot][j] = kept;
            }
        const double scale = 1 / m[c][c];
        for (int j = 0; j < 8; j++) m[c][j] *= scale;
        for (int i = 0; i < 4; i++) {
            const double factor = m[i][c];
            if (i == c || factor == 0.0) continue;
            for (int j = 0; j < 8; j++) m[i][j] -= factor * m[c][j];
        }
    }
    for (int i = 0; i < 4; i++) memcpy(inverse + 4 * i, m[i] + 4, 4 * sizeof(double));
    return 1;
}

/* Sum of products of n values; in four parts, which a processor adds side by side. */
static double dot(const double *a, const double *b, Py_ssize_t n)
{
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    Py_ssize_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (int part = 0; part < 4; part++) sum[part] += a[i + part] * b[i + part];
    for (; i < n; i++) sum[0] += a[i] * b[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

/* The value of rank `rank` of n values, whose order is lost. */
static double select_rank(double *v, Py_ssize_t n, Py_ssize_t rank)
{
    Py_ssize_t low = 0, high = n - 1;
    while (low < high) {
        const double pivot = v[low + (high - low) / 2];
        Py_ssize_t i = low, j = high;
        while (i <= j) {
            while (v[i] < pivot) i++;
            while (pivot < v[j]) j--;
            if (i <= j) {
                const double kept = v[i];
                v[i++] = v[j];
                v[j--] = kept;
            }
        }
        if (rank <= j) high = j;
        else if (rank >= i) low = i;
        else break;
    }
    return v[rank];
}

/* Index of the first of n rising values that is no smaller; all are smaller than NaN. */
static Py_ssize_t search_sorted(const double *v, Py_ssize_t n, double value)
{
    Py_ssize_t low = 0, high = n;
    if (isnan(value)) return n;
    while (low < high) {
        const Py_ssize_t middle = low + (high - low) / 2;
        if (v[middle] < value) low = middle + 1;
        else high = middle;
    }
    return low;
}

/* ---- the correlation of noise: groove/refinement.py ---- */

static double noise_share_in_fit(double parameters, double inflation, double count)
{
    return smaller(parameters * larger(inflation, 1.0) / count, LARGEST_NOISE_SHARE_IN_FIT);
}

static double lag_of_half_correlation(const double *rho)
{
    int k = 1;
    while (k < LONGEST_LAG && !(rho[k] < 0.5)) k++;
    if (k == LONGEST_LAG) return WIDEST_HALF_LAG;
    const double before = -log(smaller(larger(rho[k - 1], _LEAST_CORRELATION), 1.0));
    const double after = -log(smaller(larger(rho[k], _LEAST_CORRELATION), 1.0));
    return smaller(larger(k - 1 + (log(2.0) - before) / (after - before), _SHORTEST_LAG), WIDEST_HALF_LAG);
}

static int count_bits(uint64_t v)
{
    v -= v >> 1 & 0x5555555555555555u;
    v = (v & 0x3333333333333333u) + (v >> 2 & 0x3333333333333333u);
    return (int)(((v + (v >> 4)) & 0x0f0f0f0f0f0f0f0fu) * 0x0101010101010101u >> 56);
}

/* `grid` holds scaled residuals by column, zero where there is none; `held`, bit by bit, says where, with
   a word more in the end. */
static double inflation_of(
    const double *grid, const uint64_t *held, Py_ssize_t columns, double count, double parameters)
{
    double rho[LONGEST_LAG], put_back[LONGEST_LAG], lost = 0.0, inflation = 1.0;
    for (int k = 0; k < LONGEST_LAG; k++) {
        int pairs = 0;
        for (Py_ssize_t i = 0; i <= columns / 64; i++)
            pairs += count_bits(held[i] & (k ? held[i] >> k | held[i + 1] << (64 - k) : held[i]));
        rho[k] = dot(grid + k, grid, columns > k ? columns - k : 0) / larger(pairs, 1.0);
    }
    const double scale = larger(rho[0], 1e-30);
    for (int k = 0; k < LONGEST_LAG; k++) rho[k] /= scale;
    for (int round = 0; round < 3; round++) {
        for (int k = 0; k < LONGEST_LAG; k++) put_back[k] = rho[k] * (1 - lost) + lost;
        const double half = lag_of_half_correlation(put_back);
        double total = 0.0;
        for (int k = 0; k < LONGEST_LAG; k++) total += pow(0.5, pow(k / half, CORRELATION_POWER));
        inflation = larger(2 * total - 1, 1.0);
        lost = noise_share_in_fit(parameters, inflation, count);
    }
    return inflation;
}

/* ---- refine_fit: groove/refinement.py ---- */

typedef struct {
    double bend, twist, expected_bend, roughness; /* bend and twist in powers of s / 20 mm */
    int bead, bend_is_expected;
} Side;

typedef struct {
    Py_ssize_t n;
    const double *x, *z;
    const int64_t *columns;
    Py_ssize_t column_count;
    double *u, *along, *residuals, *scaled, *work, *grid;
    uint64_t *held;
    uint8_t *keep, *left_out;
    int is_left_out; /* whether any points are */
} Row;

typedef struct {
    int k, curved[MOST_SIDES];
    Curve curves[MOST_SIDES];
    double places[MOST_SIDES][2], corners[MOST_SIDES][2];
    Py_ssize_t edges[MOST_SIDES + 1];
    double sigmas[MOST_SIDES], counts[MOST_SIDES], middles[MOST_SIDES], straight[MOST_SIDES];
    double matrix[MOST_SIDES][16], rhs[MOST_SIDES][4], inverse[MOST_SIDES][16], weight[MOST_SIDES][4];
} Fit;

/* _drop_points_beside_ghosts of one side, whose points are first..last - 1. */
static void drop_points_beside_ghosts(const Row *row, Py_ssize_t first, Py_ssize_t last)
{
    for (Py_ssize_t a = first, b; a < last; a = b) {
        const int beside = (row->scaled[a] > GHOST_SIGMAS) - (row->scaled[a] < -GHOST_SIGMAS);
        Py_ssize_t outliers = 0;
        for (b = a; b < last; b++) {
            if ((row->scaled[b] > GHOST_SIGMAS) - (row->scaled[b] < -GHOST_SIGMAS) != beside) break;
            outliers += !row->keep[b];
        }
        if (a == first && b == last) return;
        if (outliers >= FEWEST_POINTS_OF_GHOST) memset(row->keep + a, 0, (size_t)(b - a));
    }
}

/* _fit_sides_once: from the curves and corners in `fit`, into it; 0 if there is no fit. */
static int fit_sides_once(
    const Row *row, Fit *fit, const double *limits, double weight[][4], const Side *sides, int settled)
{
    const int k = fit->k;
    fit->edges[0] = 0;
    fit->edges[k] = row->n;
    for (int j = 0; j < k - 1; j++)
        fit->edges[j + 1] = search_sorted(row->u, row->n, -fit->corners[j][0] / fit->corners[j][1]);
    for (int j = 0; j < k; j++)
        if (fit->edges[j + 1] - fit->edges[j] < FEWEST_SIDE_POINTS) return 0;
    for (int j = 0; j < k; j++) {
        const Curve c = fit->curves[j];
        const double es = c.cx * c.tx + c.cz * c.tz, ed = c.cx * c.tz - c.cz * c.tx;
        const double scale = OUTLIER_SIGMAS / limits[j];
        for (Py_ssize_t i = fit->edges[j]; i < fit->edges[j + 1]; i++) {
            const double s = row->x[i] * c.tx + row->z[i] * c.tz - es;
            const double d = row->x[i] * c.tz - row->z[i] * c.tx - ed;
            row->along[i] = s;
            row->residuals[i] = d;
            row->scaled[i] = (d - (c.c0 + s * (c.c1 + s * (c.c2 + s * c.c3)))) * scale;
            row->keep[i] = fabs(row->scaled[i]) < OUTLIER_SIGMAS;
        }
        if (settled && !sides[j].bead) drop_points_beside_ghosts(row, fit->edges[j], fit->edges[j + 1]);
    }
    if (row->is_left_out)
        for (Py_ssize_t i = 0; i < row->n; i++) row->keep[i] &= !row->left_out[i];

    double total = 0.0, pooled = 0.0, sums[MOST_SIDES][11];
    for (int j = 0; j < k; j++) {
        double *sum = sums[j];
        memset(sum, 0, sizeof sums[j]);
        for (Py_ssize_t i = fit->edges[j]; i < fit->edges[j + 1]; i++) {
            if (!row->keep[i]) continue;
            const double u = row->along[i] * (1 / SCALING_LENGTH), d = row->residuals[i];
            const double u2 = u * u, u3 = u2 * u;
            sum[0] += 1.0;
            sum[1] += u;
            sum[2] += u2;
            sum[3] += u3;
            sum[4] += u2 * u2;
            sum[5] += u2 * u3;
            sum[6] += u3 * u3;
            sum[7] += d;
            sum[8] += u * d;
            sum[9] += u2 * d;
            sum[10] += u3 * d;
        }
        if (sum[0] < FEWEST_SIDE_POINTS) return 0;
    }
    for (int j = 0; j < k; j++) {
        const double expected[4] = {0.0, 0.0, sides[j].expected_bend, 0.0};
        double *m = fit->matrix[j], with_prior[16], rhs[4], c[4] = {0.0, 0.0, 0.0, 0.0};
        for (int a = 0; a < 4; a++) {
            for (int b = 0; b < 4; b++) m[4 * a + b] = sums[j][a + b];
            fit->rhs[j][a] = sums[j][7 + a];
            fit->weight[j][a] = weight[j][a];
        }
        memcpy(with_prior, m, sizeof with_prior);
        for (int a = 0; a < 4; a++) {
            with_prior[5 * a] += weight[j][a];
            rhs[a] = fit->rhs[j][a] + (weight[j][a] < FIXED_WEIGHT ? weight[j][a] * expected[a] : 0.0);
        }
        if (!invert(with_prior, fit->inverse[j])) return 0;
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < 4; b++) c[a] += fit->inverse[j][4 * a + b] * rhs[b];
        fit->counts[j] = sums[j][0];
        fit->middles[j] = SCALING_LENGTH * sums[j][1] / sums[j][0];
        Py_ssize_t kept = 0;
        for (Py_ssize_t i = fit->edges[j]; i < fit->edges[j + 1]; i++) {
            const double u = row->along[i] * (1 / SCALING_LENGTH);
            row->residuals[i] -= c[0] + u * (c[1] + u * (c[2] + u * c[3]));
            if (row->keep[i]) row->work[kept++] = fabs(row->residuals[i]);
        }
        fit->sigmas[j] = _MAD_TO_SIGMA * select_rank(row->work, kept, kept / 2);
        pooled += fit->sigmas[j] * fit->counts[j];
        total += fit->counts[j];
        Curve *curve = &fit->curves[j];
        curve->c0 = c[0];
        curve->c1 = c[1] / SCALING_LENGTH;
        curve->c2 = c[2] / (SCALING_LENGTH * SCALING_LENGTH);
        curve->c3 = c[3] / (SCALING_LENGTH * SCALING_LENGTH * SCALING_LENGTH);
    }
    pooled /= total;
    for (int j = 0; j < k; j++)
        fit->sigmas[j] = (fit->counts[j] * fit->sigmas[j] + POOLED_NOISE_POINTS * pooled)
                         / (fit->counts[j] + POOLED_NOISE_POINTS);
    for (int j = 0; j < k - 1; j++) {
        const Curve *a = &fit->curves[j];
        const double near = position_along_chord(a, fit->corners[j][0], fit->corners[j][1]);
        if (!intersect_curves(a, a + 1, near, fit->places[j])) return 0;
        point_on_curve(a, fit->places[j][0], &fit->corners[j][0], &fit->corners[j][1]);
    }
    return 1;
}

static double estimate_variance_inflation(const Row *row, const Fit *fit)
{
    double count = 0.0, parameters = 0.0;
    memset(row->grid, 0, (size_t)row->column_count * sizeof(double));
    memset(row->held, 0, (size_t)(row->column_count / 64 + 2) * sizeof(uint64_t));
    for (int j = 0; j < fit->k; j++) {
        const double sigma = larger(fit->sigmas[j], 1e-9);
        for (Py_ssize_t i = fit->edges[j]; i < fit->edges[j + 1]; i++)
            if (row->keep[i]) {
                row->grid[row->columns[i]] = row->residuals[i] / sigma;
                row->held[row->columns[i] / 64] |= (uint64_t)1 << row->columns[i] % 64;
                count += 1.0;
            }
        parameters += 2 + fit->curved[j];
    }
    return inflation_of(row->grid, row->held, row->column_count, count, parameters);
}

static void log_odds_of_straight_sides(Fit *fit, double inflation, const Side *sides)
{
    for (int j = 0; j < fit->k; j++) {
        if (sides[j].bend_is_expected) {
            fit->straight[j] = -INFINITY;
            continue;
        }
        const double *c = fit->inverse[j] + 8; /* symmetric: row and column of the bend */
        const double lost = noise_share_in_fit(2 + fit->curved[j], inflation, fit->counts[j]);
        double variance = 0.0;
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < 4; b++) variance += c[a] * fit->matrix[j][4 * a + b] * c[b];
        variance *= inflation * (fit->sigmas[j] * fit->sigmas[j] / (1 - lost));
        const double spread[2] = {sides[j].bend, sides[j].twist};
        for (int a = 0; a < 2; a++) {
            const double w = fit->weight[j][2 + a];
            const double doubt = w < FIXED_WEIGHT ? w * spread[a] : 0.0;
            variance += c[2 + a] * doubt * c[2 + a] * doubt;
        }
        variance = larger(variance, 1e-30);
        const double bend = fit->curves[j].c2 * SCALING_LENGTH * SCALING_LENGTH;
        const double prior = larger(sides[j].bend, 1e-15);
        fit->straight[j] = log(prior) - 0.5 * log(variance) - bend * bend / (2 * variance);
    }
}

/* Marks points beside holes if the surface seems to curl there; 0 if it does not. */
static int find_curled_rims(const Row *row, const Fit *fit, const Side *sides)
{
    const Py_ssize_t n = row->n;
    Py_ssize_t rims = 0, first = 0, width = 0;
    for (int pass = 0; pass < 2; pass++) {
        for (int way = 0; way < 2; way++)
            for (Py_ssize_t hole = 0; hole + 1 < n; hole++) {
                if (llabs(row->columns[hole + 1] - row->columns[hole]) <= LEAST_COLUMNS_OF_HOLE) continue;
                Py_ssize_t run = 0, steps = pass ? width : RIM_POINTS;
                int unbroken = 1;
                for (Py_ssize_t step = 0; step < steps; step++) {
                    Py_ssize_t i = way ? hole + 1 + step : hole - step;
                    i = i < 0 ? 0 : i > n - 1 ? n - 1 : i;
                    if (pass) {
                        row->left_out[i] = 1;
                        continue;
                    }
                    int owner = 0;
                    while (owner < fit->k - 1 && i >= fit->edges[owner + 1]) owner++;
                    const double off = fabs(row->residuals[i]);
                    if (step == 0 && (sides[owner].bead || !(off < LARGEST_CURL))) break;
                    rims += step == 0;
                    unbroken &= off / larger(fit->sigmas[owner], LEAST_NOISE) > LEAST_CURL_SIGMAS;
                    first += step == 0 && unbroken;
                    run += unbroken;
                }
                width = run > width && !pass ? run : width;
            }
        if (pass == 0) {
            if (first < FEWEST_CURLED_RIMS || 2 * first <= rims) return 0;
            width = width < RIM_POINTS ? width + 1 : RIM_POINTS;
        }
    }
    return 1;
}

/* The sides of a model from Python's array; 0 if an outer one is a bead. */
static int read_sides(const double *model, Py_ssize_t k, Side *sides)
{
    for (Py_ssize_t j = 0; j < k; j++) {
        const double *m = model + MODEL_VALUES * j;
        const Side side = {m[0], m[1], m[2], m[3], m[4] != 0, m[5] != 0};
        sides[j] = side;
        if (side.bead && (j == 0 || j == k - 1)) return 0;
    }
    return 1;
}

/* 1 if a fit was found, 2 if it is near a known one, 0 if there is none. */
static int refine(
    Row *row, Fit *fit, const Side *sides, double tolerance, int annealed, const double *known,
    Py_ssize_t known_count, double *variance_inflation)
{
    static const double FIRST_ROUND_TOLERANCES[3] = {4.0, 2.0, 1.0};
    const int k = fit->k, widths = annealed ? 2 : 0;
    double inflation = _GUESSED_VARIANCE_INFLATION, sigmas[MOST_SIDES], limits[MOST_SIDES];
    double weight[MOST_SIDES][4], straight[MOST_SIDES], before[MOST_SIDES][2];
    int curved[MOST_SIDES], noise_is_known = 0, holes = 0;
    for (Py_ssize_t i = 0; i + 1 < row->n && !holes; i++)
        holes = llabs(row->columns[i + 1] - row->columns[i]) > LEAST_COLUMNS_OF_HOLE;
    for (int j = 0; j < k; j++) {
        curved[j] = sides[j].bend > 0;
        sigmas[j] = tolerance / 4;
    }
    for (int round = 0; round < MOST_REFINEMENT_ROUNDS; round++) {
        for (int j = 0; j < k; j++) {
            const Side *side = &sides[j];
            if (round < (widths > 1 ? widths : 1)) {
                limits[j] = (side->bead ? 1.0 : FIRST_ROUND_TOLERANCES[annealed ? round : 2]) * tolerance;
            } else {
                const double reach = j == 0 || j == k - 1 ? OUTER_SIDE_REACH : 1.0;
                limits[j] = smaller(OUTLIER_SIGMAS * larger(sigmas[j], LEAST_NOISE), tolerance * reach);
            }
            double blunt = side->roughness;
            if (side->bead) {
                const double gx = fit->corners[j][0] - fit->corners[j - 1][0];
                const double gz = fit->corners[j][1] - fit->corners[j - 1][1];
                blunt = larger(blunt, FACE_BLUNTNESS * fabs(fit->curves[j].c2) * (gx * gx + gz * gz) / 4);
            }
            limits[j] = larger(limits[j], blunt);
            const double noted = larger(sigmas[j], LEAST_NOISE), spread[2] = {side->bend, side->twist};
            weight[j][0] = weight[j][1] = 0.0;
            for (int a = 0; a < 2; a++)
                weight[j][2 + a] = curved[j] && spread[a] > 0
                                       ? inflation * noted * noted / (spread[a] * spread[a])
                                       : FIXED_WEIGHT;
            if (round && round < REBASED_ROUNDS)
                fit->curves[j] = rebased_at_tangent(&fit->curves[j], fit->middles[j]);
            fit->curved[j] = curved[j];
        }
        memcpy(before, fit->corners, sizeof before);
        if (!fit_sides_once(row, fit, limits, weight, sides, round >= widths)) return 0;
        for (Py_ssize_t m = 0; m < known_count; m++) {
            double apart = 0.0;
            for (int v = 0; v < 2 * (k - 1); v++)
                apart = larger(apart, fabs(fit->corners[v / 2][v % 2] - known[2 * (k - 1) * m + v]));
            if (apart < SAME_FIT_DISTANCE) return 2;
        }
        double moved = round ? 0.0 : INFINITY, mean = 0.0;
        for (int v = 0; v < 2 * (k - 1); v++)
            moved = larger(moved, fabs(fit->corners[v / 2][v % 2] - before[v / 2][v % 2]));
        for (int j = 0; j < k; j++) {
            sigmas[j] = fit->sigmas[j];
            mean += fit->sigmas[j] / k;
        }
        if (noise_is_known && moved < SETTLED_SIGMAS * larger(mean, LEAST_NOISE)) break;
        const int settling = round >= widths && moved < 0.1 * tolerance;
        if (noise_is_known || !(settling || round + 1 >= ROUNDS_BEFORE_CURVATURE_CHOICE)) continue;
        inflation = *variance_inflation = estimate_variance_inflation(row, fit);
        noise_is_known = 1;
        log_odds_of_straight_sides(fit, inflation, sides);
        memcpy(straight, fit->straight, sizeof straight);
        for (int j = 0; j < k; j++)
            curved[j] = curved[j] && straight[j] < (sides[j].bead ? 0.0 : STRAIGHT_LOG_ODDS);
        if (holes && !row->is_left_out && find_curled_rims(row, fit, sides)) {
            row->is_left_out = 1;
            noise_is_known = 0;
            for (int j = 0; j < k; j++) curved[j] = curved[j] || (sides[j].bead && sides[j].bend > 0);
        }
    }
    return noise_is_known;
}

/* Doubles of a fit of k sides, in their order in the array that Python gets. */
#define FIT_VALUES(k) ((k) * (8 + 2 + 2 + 1 + 1 + 1 + 1 + 1 + 16 + 4 + 16 + 4) - 4 + 1)

static double *put(double *to, const void *from, size_t count)
{
    memcpy(to, from, count * sizeof(double));
    return to + count;
}

static PyObject *refine_fit(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char kinds[] = "ddiddddDDB";
    Py_buffer v[10];
    PyObject *result = NULL;
    (void)self;
    if (given != 13) return PyErr_Format(PyExc_TypeError, "refine_fit takes 13 arguments");
    const Py_ssize_t column_count = PyLong_AsSsize_t(args[10]);
    const double tolerance = PyFloat_AsDouble(args[11]);
    const int annealed = PyObject_IsTrue(args[12]);
    if (PyErr_Occurred() || open_arrays(kinds, args, v) < 0) return NULL;
    const Py_ssize_t n = count_of(&v[0]), k = count_of(&v[3]) / SIDE_VALUES;
    const int64_t *columns = v[2].buf;
    int sound = k >= 2 && k <= MOST_SIDES && count_of(&v[1]) == n && count_of(&v[2]) == n
                && count_of(&v[3]) == k * SIDE_VALUES && count_of(&v[4]) == 2 * (k - 1)
                && count_of(&v[5]) == k * MODEL_VALUES && count_of(&v[6]) % (2 * (k - 1)) == 0
                && count_of(&v[7]) == FIT_VALUES(k) && count_of(&v[8]) == 2 * n && count_of(&v[9]) == n;
    for (Py_ssize_t i = 0; sound && i < n; i++) sound = columns[i] >= 0 && columns[i] < column_count;
    Side sides[MOST_SIDES];
    sound = sound && read_sides(v[5].buf, k, sides);
    double *memory = sound ? calloc((size_t)(3 * n + 2 * column_count + n / 8 + 2), sizeof(double)) : NULL;
    if (!memory) {
        if (sound) PyErr_NoMemory();
        else PyErr_SetString(PyExc_ValueError, "arrays of a fit do not match");
        close_arrays(kinds, v);
        return NULL;
    }
    Row row = {n, v[0].buf, v[1].buf, columns, column_count, memory, v[8].buf, (double *)v[8].buf + n,
               memory + n, memory + 2 * n, memory + 3 * n, (uint64_t *)(memory + 3 * n + column_count), v[9].buf,
               (uint8_t *)(memory + 3 * n + 2 * column_count), 0};
    for (Py_ssize_t i = 0; i < n; i++) row.u[i] = -row.x[i] / row.z[i];
    Fit fit;
    double inflation = 1.0;
    memset(&fit, 0, sizeof fit);
    fit.k = (int)k;
    memcpy(fit.curves, v[3].buf, (size_t)k * sizeof(Curve));
    memcpy(fit.corners, v[4].buf, (size_t)(k - 1) * 2 * sizeof(double));
    const Py_ssize_t known = count_of(&v[6]) / (2 * (k - 1));
    const int found = refine(&row, &fit, sides, tolerance, annealed, v[6].buf, known, &inflation);
    free(memory);
    if (found) {
        const size_t m = (size_t)k;
        double *to = v[7].buf;
        to = put(to, fit.curves, 8 * m);
        to = put(to, fit.places, 2 * (m - 1));
        to = put(to, fit.corners, 2 * (m - 1));
        to = put(to, fit.sigmas, m);
        to = put(to, fit.counts, m);
        to = put(to, fit.middles, m);
        to = put(to, fit.straight, m);
        for (size_t j = 0; j < m; j++) *to++ = fit.curved[j];
        to = put(to, fit.matrix, 16 * m);
        to = put(to, fit.rhs, 4 * m);
        to = put(to, fit.inverse, 16 * m);
        to = put(to, fit.weight, 4 * m);
        *to = inflation;
        result = PyTuple_New(k + 2);
        if (result) PyTuple_SetItem(result, 0, PyBool_FromLong(found == 1));
        for (Py_ssize_t j = 0; result && j <= k; j++)
            PyTuple_SetItem(result, j + 1, PyLong_FromSsize_t(fit.edges[j]));
    } else {
        result = Py_NewRef(Py_None);
    }
    close_arrays(kinds, v);
    return result;
}

/* ---- runs, noise and pieces: groove/reflections.py, groove/candidates.py ---- */

/* find_runs: first points, with n after them, and jumps of the runs; how many there are. */
static Py_ssize_t divide_in_runs(
    const double *x, const double *z, const int64_t *columns, Py_ssize_t n, int64_t *first,
    uint8_t *jumps, double *rate)
{
    Py_ssize_t count = 1;
    first[0] = 0;
    jumps[0] = 0;
    for (Py_ssize_t i = 0; i + 1 < n; i++) {
        const double dx = x[i + 1] - x[i], dz = z[i + 1] - z[i];
        rate[i] = sqrt(dx * dx + dz * dz) / (double)llabs(columns[i + 1] - columns[i]);
    }
    for (Py_ssize_t i = 0; i + 1 < n; i++) {
        const double apart = (double)llabs(columns[i + 1] - columns[i]);
        const double usual = smaller(rate[i ? i - 1 : 0], rate[i + 2 < n ? i + 1 : i]);
        const int hole = apart > LEAST_COLUMNS_OF_HOLE;
        const int jump = !hole && rate[i] * apart > JUMP_DISTANCE + JUMP_STEEPNESS * usual * apart;
        if (!hole && !jump) continue;
        first[count] = i + 1;
        jumps[count - 1] |= (uint8_t)jump;
        jumps[count++] = (uint8_t)jump;
    }
    first[count] = n;
    return count;
}

static PyObject *find_runs(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char kinds[] = "ddiIBD";
    Py_buffer v[6];
    (void)self;
    if (given != 6) return PyErr_Format(PyExc_TypeError, "find_runs takes 6 arguments");
    if (open_arrays(kinds, args, v) < 0) return NULL;
    const Py_ssize_t n = count_of(&v[0]);
    int sound = n > 0;
    for (int i = 1; i < 6; i++) sound = sound && count_of(&v[i]) == n + (i == 3);
    const Py_ssize_t count =
        sound ? divide_in_runs(v[0].buf, v[1].buf, v[2].buf, n, v[3].buf, v[4].buf, v[5].buf) : 0;
    close_arrays(kinds, v);
    if (!sound) return PyErr_Format(PyExc_ValueError, "arrays of runs do not match");
    return PyLong_FromSsize_t(count);
}

/* project_points: bearings and inverse depths, and the noise. */
static double project(
    const double *x, const double *z, Py_ssize_t n, double largest, double *u, double *y, double *work)
{
    double noise = LEAST_NOISE;
    for (Py_ssize_t i = 0; i < n; i++) {
        u[i] = -x[i] / z[i];
        y[i] = 1 / z[i];
    }
    for (int lag = 1; lag <= 4; lag += 3) {
        Py_ssize_t m = 0;
        for (Py_ssize_t i = lag; i + lag < n; i++) {
            const double share = (u[i] - u[i - lag]) / larger(u[i + lag] - u[i - lag], 1e-9);
            const double off = fabs(y[i] - (1 - share) * y[i - lag] - share * y[i + lag]) * (z[i] * z[i]);
            const double size = off / sqrt(1 + share * share + (1 - share) * (1 - share));
            if (size > LEAST_DIFFERENCE) work[m++] = size;
        }
        if (!m) continue;
        const double rank = QUIET_QUANTILE * (double)(m - 1);
        const Py_ssize_t k = (Py_ssize_t)rank;
        double quiet = select_rank(work, m, k);
        if (k + 1 < m) {
            double next = INFINITY;
            for (Py_ssize_t i = k + 1; i < m; i++) next = smaller(work[i], next);
            quiet += (rank - (double)k) * (next - quiet);
        }
        noise = larger(noise, quiet / QUIET_QUANTILE_OF_NORMAL);
    }
    return smaller(noise, largest);
}

static PyObject *project_points(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char kinds[] = "ddDDD";
    Py_buffer v[5];
    (void)self;
    if (given != 6) return PyErr_Format(PyExc_TypeError, "project_points takes 6 arguments");
    const double largest = PyFloat_AsDouble(args[5]);
    if (PyErr_Occurred() || open_arrays(kinds, args, v) < 0) return NULL;
    const Py_ssize_t n = count_of(&v[0]);
    int sound = n > 0;
    for (int i = 1; i < 5; i++) sound = sound && count_of(&v[i]) == n;
    const double noise =
        sound ? project(v[0].buf, v[1].buf, n, largest, v[2].buf, v[3].buf, v[4].buf) : 0.0;
    close_arrays(kinds, v);
    if (!sound) return PyErr_Format(PyExc_ValueError, "arrays of points do not match");
    return PyFloat_FromDouble(noise);
}

enum { MOMENTS = 9 };

/* find_pieces into first, stop, moments, probes and heights; how many there are, -1 without memory. */
static Py_ssize_t divide_in_pieces(
    const double *u, const double *y, const double *z, Py_ssize_t n, double noise,
    const int64_t *run_first, const int64_t *run_count, Py_ssize_t runs, int64_t *first, int64_t *stop,
    double *moments, double *probes, double *heights)
{
    const int64_t size = n / MOST_BLOCKS > POINTS_PER_BLOCK ? n / MOST_BLOCKS : POINTS_PER_BLOCK;
    int64_t longest_run = 0, fewest;
    Py_ssize_t blocks = 0, pieces = 0;
    for (Py_ssize_t r = 0; r < runs; r++) longest_run = run_count[r] > longest_run ? run_count[r] : longest_run;
    fewest = longest_run < FEWEST_RUN_POINTS ? longest_run : FEWEST_RUN_POINTS;
    double *through = malloc((size_t)(n + 1) * (MOMENTS + 8) * sizeof(double));
    if (!through) return -1;
    double *rows = through + (n + 1) * MOMENTS; /* the six sums that costs need, each in a row */
    double *least = rows + 6 * (n + 1);
    int64_t *begin = (int64_t *)(least + n + 1);
    int64_t *start = malloc((size_t)(n + 1) * 2 * sizeof(int64_t)), *end = start + n + 1;
    if (!start) {
        free(through);
        return -1;
    }
    double running[MOMENTS] = {0.0}, before[MOMENTS] = {0.0}, total[MOMENTS] = {0.0};
    memset(through, 0, MOMENTS * sizeof(double));
    Py_ssize_t point = 0;
    for (Py_ssize_t r = 0; r < runs; r++) {
        const int64_t own = run_count[r] / size > 1 ? run_count[r] / size : 1;
        for (int64_t b = 0; run_count[r] >= fewest && b < own; b++) {
            start[blocks] = run_first[r] + b * run_count[r] / own;
            end[blocks] = run_first[r] + (b + 1) * run_count[r] / own;
            for (; point < end[blocks]; point++) {
                if (point == start[blocks]) memcpy(before, running, sizeof before);
                const double square = z[point] * z[point];
                double term[MOMENTS];
                term[0] = square * square;
                for (int k = 0; k < 4; k++) term[k + 1] = term[k] * u[point];
                for (int k = 0; k < 3; k++) term[5 + k] = term[k] * y[point];
                term[8] = term[5] * y[point];
                for (int k = 0; k < MOMENTS; k++) running[k] += term[k];
            }
            for (int k = 0; k < MOMENTS; k++) {
                total[k] += running[k] - before[k];
                through[(blocks + 1) * MOMENTS + k] = total[k];
            }
            blocks++;
        }
    }
    static const int USED[6] = {0, 1, 2, 5, 6, 8};
    for (int k = 0; k < 6; k++)
        for (Py_ssize_t i = 0; i <= blocks; i++) rows[k * (n + 1) + i] = through[i * MOMENTS + USED[k]];
    const double variance = 2 * NOISE_INFLATION * (noise * noise + LEAST_UNEVENNESS * LEAST_UNEVENNESS);
    least[0] = 0.0;
    for (Py_ssize_t j = 1; j <= blocks; j++) {
        const Py_ssize_t from = j > LONGEST_PIECE_BLOCKS ? j - LONGEST_PIECE_BLOCKS : 0;
        double cost[LONGEST_PIECE_BLOCKS];
        for (Py_ssize_t i = from; i < j; i++) {
            const double *r = rows + i, *own = rows + j;
            const double w = own[0] - r[0], c = own[3 * (n + 1)] - r[3 * (n + 1)];
            const double a = (own[n + 1] - r[n + 1]) / w;
            const double b = larger(own[2 * (n + 1)] - r[2 * (n + 1)] - a * a * w, 1e-15);
            const double d = own[4 * (n + 1)] - r[4 * (n + 1)] - a * c;
            const double e = own[5 * (n + 1)] - r[5 * (n + 1)] - (c * c / w + d * d / b);
            cost[i - from] = least[i] + (larger(e, 0.0) / variance + PIECE_COST);
        }
        least[j] = INFINITY;
        begin[j] = from;
        for (Py_ssize_t i = from; i < j; i++)
            if (cost[i - from] < least[j]) {
                least[j] = cost[i - from];
                begin[j] = i;
            }
    }
    for (Py_ssize_t j = blocks; j > 0; j = begin[j]) pieces++;
    Py_ssize_t kept = pieces;
    for (Py_ssize_t j = blocks; j > 0; j = begin[j]) {
        double m[MOMENTS];
        for (int k = 0; k < MOMENTS; k++) m[k] = through[j * MOMENTS + k] - through[begin[j] * MOMENTS + k];
        const double middle = m[1] / m[0], height = m[5] / m[0];
        const double spread = sqrt(larger(m[2] / m[0] - middle * middle, 1e-18));
        if (!(spread > LEAST_BEARING_SPREAD)) continue;
        const double slope = (m[6] - m[1] * m[5] / m[0]) / (m[0] * (spread * spread));
        kept--;
        first[kept] = start[begin[j]];
        stop[kept] = end[j - 1];
        memcpy(moments + kept * MOMENTS, m, sizeof m);
        for (int k = 0; k < 2; k++) {
            probes[2 * kept + k] = middle + (k ? spread : -spread);
            heights[2 * kept + k] = height + slope * (probes[2 * kept + k] - middle);
        }
    }
    const size_t found = (size_t)(pieces - kept);
    memmove(first, first + kept, found * sizeof(int64_t));
    memmove(stop, stop + kept, found * sizeof(int64_t));
    memmove(moments, moments + kept * MOMENTS, found * MOMENTS * sizeof(double));
    memmove(probes, probes + 2 * kept, found * 2 * sizeof(double));
    memmove(heights, heights + 2 * kept, found * 2 * sizeof(double));
    free(start);
    free(through);
    return (Py_ssize_t)found;
}

static PyObject *find_pieces(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char kinds[] = "dddiiIIDDD";
    Py_buffer v[10];
    (void)self;
    if (given != 11) return PyErr_Format(PyExc_TypeError, "find_pieces takes 11 arguments");
    const double noise = PyFloat_AsDouble(args[10]);
    if (PyErr_Occurred() || open_arrays(kinds, args, v) < 0) return NULL;
    const Py_ssize_t n = count_of(&v[0]), runs = count_of(&v[3]);
    const int64_t *first = v[3].buf, *count = v[4].buf;
    int sound = n > 0 && runs > 0 && count_of(&v[1]) == n && count_of(&v[2]) == n && count_of(&v[4]) == runs
                && count_of(&v[5]) == n && count_of(&v[6]) == n && count_of(&v[7]) == MOMENTS * n
                && count_of(&v[8]) == 2 * n && count_of(&v[9]) == 2 * n;
    int64_t next = 0;
    for (Py_ssize_t r = 0; sound && r < runs; r++) {
        sound = first[r] == next && count[r] > 0;
        next += count[r];
    }
    sound = sound && next == n;
    const Py_ssize_t found =
        sound ? divide_in_pieces(v[0].buf, v[1].buf, v[2].buf, n, noise, first, count, runs, v[5].buf,
                                 v[6].buf, v[7].buf, v[8].buf, v[9].buf)
              : 0;
    close_arrays(kinds, v);
    if (!sound) return PyErr_Format(PyExc_ValueError, "arrays of pieces do not match");
    return found < 0 ? PyErr_NoMemory() : PyLong_FromSsize_t(found);
}

/* ---- candidates: groove/candidates.py ---- */

enum { KIND_VALUES = 4 };

typedef struct {
    double c[3], inverse[9], steep, height;
} Parabola;

/* _fit_sums and _steepness_and_height. */
static void fit_sums(const double *sums, double bend, double variance, int with_inverse, Parabola *p)
{
    const double w = sums[0], a = sums[1], b = sums[2], c = sums[3];
    const double u = a / w, y = sums[5] / w;
    const double inclined = (sums[6] - u * sums[5]) / larger(b - u * a, 1e-18), away = u * inclined - y;
    p->steep = sqrt(away * away + inclined * inclined);
    p->height = y;
    const double r = y / p->steep, r2 = r * r;
    const double d = sums[4] + variance * (r2 * r2 * r2) / (bend * bend);
    const double slope = a / w, square = b / w;
    const double first = larger(b - slope * a, LEAST_PIVOT), turn = (c - square * a) / first;
    const double second = larger(d - square * b - turn * turn * first, LEAST_PIVOT);
    const double h0 = 1 / sqrt(w), h1 = 1 / sqrt(first), h2 = 1 / sqrt(second);
    const double half[3][3] = {
        {h0, 0.0, 0.0}, {-slope * h1, h1, 0.0}, {(turn * slope - square) * h2, -turn * h2, h2}};
    double m[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            m[3 * i + j] = half[0][i] * half[0][j] + half[1][i] * half[1][j] + half[2][i] * half[2][j];
    for (int i = 0; i < 3; i++) p->c[i] = m[3 * i] * sums[5] + m[3 * i + 1] * sums[6] + m[3 * i + 2] * sums[7];
    if (with_inverse) memcpy(p->inverse, m, sizeof m);
}

/* _squared_errors */
static double squared_error(const double *sums, const Parabola *p)
{
    const double error = sums[8] - (p->c[0] * sums[5] + p->c[1] * sums[6] + p->c[2] * sums[7]);
    const double r = p->height / p->steep;
    return larger(error, 0.0) * (r * r);
}

typedef struct {
    int kind;
    int64_t points;
    const uint8_t *member;
    Py_ssize_t pieces;
} Group;

static int compare_groups(const void *a, const void *b)
{
    const Group *g = a, *h = b;
    if (g->kind != h->kind) return g->kind < h->kind ? -1 : 1;
    if (g->points != h->points) return g->points > h->points ? -1 : 1;
    return memcmp(g->member, h->member, (size_t)g->pieces);
}

typedef struct {
    Py_ssize_t count;
    const int64_t *first, *stop;
    const double *moments, *probes, *heights;
} PieceArrays;

static void add_moments(double *sums, const PieceArrays *p, Py_ssize_t piece)
{
    for (int k = 0; k < MOMENTS; k++) sums[k] += p->moments[piece * MOMENTS + k];
}

/* _grow_seeds for one seed: marks the pieces that continue it. */
static void grow(
    const PieceArrays *p, Py_ssize_t seed, const double *kind, double variance, uint8_t *member,
    double *score, double *work)
{
    Parabola curve;
    fit_sums(p->moments + seed * MOMENTS, kind[0], variance, 0, &curve);
    const double steep = curve.steep;
    double sums[MOMENTS], *scale = work, *own = work + 2 * p->count;
    for (Py_ssize_t i = 0; i < 2 * p->count; i++) {
        scale[i] = 1 / (p->heights[i] * steep);
        const double far = p->heights[i] * p->heights[i] * scale[i];
        const double points = (double)(p->stop[i / 2] - p->first[i / 2]);
        own[i] = 2 * variance / points * (far * far) + kind[1] * kind[1];
    }
    for (int round = 0; round < MOST_GROWTH_ROUNDS; round++) {
        memset(sums, 0, sizeof sums);
        for (Py_ssize_t i = 0; i < p->count; i++)
            if (member[i]) add_moments(sums, p, i);
        fit_sums(sums, kind[0], variance, 1, &curve);
        const double *m = curve.inverse;
        Py_ssize_t best = -1, added = 0;
        for (Py_ssize_t i = 0; i < p->count; i++) {
            if (member[i]) continue;
            double most_score = 0.0, most_off = 0.0, most_doubt = 0.0;
            for (Py_ssize_t j = 2 * i; j < 2 * i + 2; j++) {
                const double u = p->probes[j], u2 = u * u;
                const double away = (curve.c[0] + curve.c[1] * u + curve.c[2] * u2 - p->heights[j]) * scale[j];
                const double off = away * away;
                const double spread = m[0] + u2 * (m[4] + m[2] + m[6]) + u * (m[1] + m[3])
                                      + u2 * u * (m[5] + m[7]) + u2 * u2 * m[8];
                const double doubt = variance * larger(spread, 0.0) * (scale[j] * scale[j]);
                most_score = larger(most_score, off / (doubt + own[j]));
                most_off = larger(most_off, off);
                most_doubt = larger(most_doubt, doubt);
            }
            score[i] = INFINITY;
            if (!(most_score < CONTINUING_SIGMAS * CONTINUING_SIGMAS)) continue;
            if (most_doubt < SURE_PREDICTION * SURE_PREDICTION) {
                member[i] = 2;
                added++;
            } else if (larger(most_doubt, most_off) < LIKELY_PREDICTION * LIKELY_PREDICTION) {
                score[i] = most_score * most_doubt;
                if (best < 0 || score[i] < score[best]) best = i;
            }
        }
        if (!added && best < 0) break;
        if (!added) member[best] = 1;
        for (Py_ssize_t i = 0; i < p->count; i++) member[i] = member[i] != 0;
    }
}

/* _best_ranges for one kind: what each range of pieces explains, and which are the best. */
static Py_ssize_t find_best_ranges(
    const PieceArrays *p, const double *kind, double variance, double *gain, double *most,
    uint8_t *members, Py_ssize_t room)
{
    const Py_ssize_t count = p->count;
    Py_ssize_t found = 0;
    double *of_start = most, *of_stop = most + count + 1, through[MOMENTS], before[MOMENTS], sums[MOMENTS];
    for (Py_ssize_t i = 0; i < 2 * (count + 1); i++) most[i] = -INFINITY;
    memset(before, 0, sizeof before);
    for (Py_ssize_t start = 0; start < count; start++) {
        int64_t points = 0;
        memcpy(through, before, sizeof before);
        for (Py_ssize_t stop = start + 1; stop <= count && stop - start <= MOST_RANGE_PIECES; stop++) {
            Parabola curve;
            add_moments(through, p, stop - 1);
            for (int k = 0; k < MOMENTS; k++) sums[k] = through[k] - before[k];
            points += p->stop[stop - 1] - p->first[stop - 1];
            fit_sums(sums, kind[0], variance, 0, &curve);
            const double own = (double)points - squared_error(sums, &curve) / (kind[3] * kind[3]);
            gain[start * (count + 1) + stop] = own;
            of_start[start] = larger(of_start[start], own);
            of_stop[stop] = larger(of_stop[stop], own);
        }
        add_moments(before, p, start);
    }
    for (Py_ssize_t start = 0; start < count; start++)
        for (Py_ssize_t stop = start + 1; stop <= count && stop - start <= MOST_RANGE_PIECES; stop++) {
            const double own = gain[start * (count + 1) + stop];
            if (own != of_start[start] || own != of_stop[stop] || !(own > 0) || found == room) continue;
            memset(members + found * count, 0, (size_t)count);
            memset(members + found * count + start, 1, (size_t)(stop - start));
            found++;
        }
    return found;
}

/* propose_candidates into kinds, roughness, coefficients, firsts and lasts; how many there are. */
static Py_ssize_t propose(
    const PieceArrays *p, const double *u, const double *table, Py_ssize_t kinds, double variance,
    int64_t *kind, double *roughness, double *coefficients, double *first, double *last)
{
    const Py_ssize_t count = p->count, seeds = 2 * kinds * count;
    uint8_t *members = calloc((size_t)(seeds * count), 1);
    Group *groups = malloc((size_t)seeds * sizeof(Group));
    double *work = malloc((size_t)((count + 1) * (count + 1) + 7 * (count + 1)) * sizeof(double));
    Py_ssize_t found = -1, grown = 0;
    if (members && groups && work) {
        for (int k = 0; k < kinds; k++) {
            const double *own = table + KIND_VALUES * k;
            const Py_ssize_t before = grown;
            for (Py_ssize_t i = 0; i < count && own[2] > 0; i++) {
                if ((double)(p->stop[i] - p->first[i]) < own[2]) continue;
                uint8_t *member = members + grown++ * count;
                member[i] = 1;
                grow(p, i, own, variance, member, work, work + count);
            }
            if (own[3] > 0)
                grown += find_best_ranges(p, own, variance, work, work + (count + 1) * (count + 1),
                                          members + grown * count, count);
            for (Py_ssize_t g = before; g < grown; g++) {
                Group group = {k, 0, members + g * count, count};
                for (Py_ssize_t i = 0; i < count; i++)
                    if (group.member[i]) group.points += p->stop[i] - p->first[i];
                groups[g] = group;
            }
        }
        qsort(groups, (size_t)grown, sizeof(Group), compare_groups);
        found = 0;
        int of_kind = 0;
        for (Py_ssize_t g = 0; g < grown; g++) {
            const Group *own = &groups[g];
            if (g && compare_groups(own, own - 1) == 0) continue;
            of_kind = g && own->kind == own[-1].kind ? of_kind + 1 : 0;
            if (of_kind >= MOST_CANDIDATES) continue;
            double sums[MOMENTS] = {0.0};
            Py_ssize_t begin = -1, end = 0;
            for (Py_ssize_t i = 0; i < count; i++)
                if (own->member[i]) {
                    add_moments(sums, p, i);
                    begin = begin < 0 ? i : begin;
                    end = i;
                }
            Parabola curve;
            fit_sums(sums, table[KIND_VALUES * own->kind], variance, 0, &curve);
            kind[found] = own->kind;
            roughness[found] = sqrt(squared_error(sums, &curve) / (double)own->points);
            memcpy(coefficients + 3 * found, curve.c, sizeof curve.c);
            first[found] = u[p->first[begin]];
            last[found] = u[p->stop[end] - 1];
            found++;
        }
    }
    free(work);
    free(groups);
    free(members);
    return found;
}

static PyObject *propose_candidates(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char letters[] = "diiddddIDDDD";
    enum { U, FIRST, STOP, MOMENT, PROBE, HEIGHT, TABLE, KIND, ROUGH, COEFFICIENT, BEGIN, END };
    Py_buffer v[12];
    (void)self;
    if (given != 13) return PyErr_Format(PyExc_TypeError, "propose_candidates takes 13 arguments");
    const double variance = PyFloat_AsDouble(args[12]);
    if (PyErr_Occurred() || open_arrays(letters, args, v) < 0) return NULL;
    const Py_ssize_t count = count_of(&v[FIRST]), kinds = count_of(&v[TABLE]) / KIND_VALUES;
    const Py_ssize_t room = kinds * MOST_CANDIDATES;
    int sound = count > 0 && kinds > 0 && count_of(&v[STOP]) == count && count_of(&v[MOMENT]) == MOMENTS * count
                && count_of(&v[PROBE]) == 2 * count && count_of(&v[HEIGHT]) == 2 * count
                && count_of(&v[TABLE]) == KIND_VALUES * kinds && count_of(&v[KIND]) == room
                && count_of(&v[ROUGH]) == room && count_of(&v[COEFFICIENT]) == 3 * room
                && count_of(&v[BEGIN]) == room && count_of(&v[END]) == room;
    const int64_t *first = v[FIRST].buf, *stop = v[STOP].buf;
    for (Py_ssize_t i = 0; sound && i < count; i++)
        sound = first[i] >= 0 && first[i] < stop[i] && stop[i] <= count_of(&v[U]);
    Py_ssize_t found = 0;
    if (sound) {
        const PieceArrays pieces = {count, first, stop, v[MOMENT].buf, v[PROBE].buf, v[HEIGHT].buf};
        found = propose(&pieces, v[U].buf, v[TABLE].buf, kinds, variance, v[KIND].buf, v[ROUGH].buf,
                        v[COEFFICIENT].buf, v[BEGIN].buf, v[END].buf);
    }
    close_arrays(letters, v);
    if (!sound) return PyErr_Format(PyExc_ValueError, "arrays of candidates do not match");
    return found < 0 ? PyErr_NoMemory() : PyLong_FromSsize_t(found);
}

/* ---- chains of candidates: groove/chains.py ---- */

enum { FORM_VALUES = 7 };

typedef struct {
    double x, z, before, after, ways[4]; /* ways: rise along both directions, and depth */
    Py_ssize_t place;
} Corner;

enum { NOT_LOOKED_AT, NOWHERE, SOMEWHERE, WITH_ANGLES };

typedef struct {
    Py_ssize_t n, count, runs;
    const double *u, *z;
    const int64_t *kind, *run_first, *run_count;
    const uint8_t *run_jumps;
    const double *coefficients, *first, *last;
    double *paid, *sums, *least; /* of each candidate: n, n + 1, n + 1 values */
    Corner *corners;
    uint8_t *states; /* what is known of each corner */
    double bounds[4]; /* least and largest x, then z, of corners */
} Search;

/* What each point pays each candidate, with running sums: ChainSearch. */
static void prepare(Search *s, const double *roughness, double tolerance)
{
    double *share = s->least; /* of what it pays, at most: in the row that is written last */
    const Py_ssize_t n = s->n;
    s->bounds[0] = s->bounds[2] = INFINITY;
    s->bounds[1] = s->bounds[3] = -INFINITY;
    for (Py_ssize_t i = 0; i < n; i++) {
        const double x = s->u[i] * -s->z[i];
        s->bounds[0] = smaller(s->bounds[0], x);
        s->bounds[1] = larger(s->bounds[1], x);
        s->bounds[2] = smaller(s->bounds[2], s->z[i]);
        s->bounds[3] = larger(s->bounds[3], s->z[i]);
    }
    for (int i = 0; i < 4; i++)
        s->bounds[i] += i % 2 ? CORNER_DISTANCE_BEYOND_POINTS : -CORNER_DISTANCE_BEYOND_POINTS;
    share += (s->count - 1) * (n + 1) + 1;
    for (Py_ssize_t r = 0; r < s->runs; r++) {
        const double whole = smaller(RUN_COST / (double)s->run_count[r] + POINT_COST, 1.0);
        for (int64_t i = 0; i < s->run_count[r]; i++)
            share[s->run_first[r] + i] = s->run_jumps[r] ? whole : 1.0;
    }
    for (Py_ssize_t k = 0; k < s->count; k++) {
        const double *c = s->coefficients + 3 * k, ends[3] = {s->first[k], 0.5 * (s->first[k] + s->last[k]), s->last[k]};
        double y[3], farthest = 0.0;
        for (int e = 0; e < 3; e++) y[e] = c[0] + ends[e] * (c[1] + ends[e] * c[2]);
        const double slope = c[1] + 2 * ends[1] * c[2], along = ends[1] * slope - y[1];
        const double steep = sqrt(along * along + slope * slope);
        if (s->kind[k] == BEAD_KIND) farthest = FACE_BLUNTNESS * (fabs(y[1] - 0.5 * (y[0] + y[2])) / (y[1] * steep));
        if (s->kind[k] == WELD_KIND) farthest = WELD_ROUGHNESS;
        const double reach = larger(smaller(ROUGH_REACH_SIGMAS * roughness[k], farthest), tolerance);
        const double wider = WIDER_TOLERANCE_COST * log(reach / tolerance), scale = steep * reach;
        const double a = c[0] / scale, b = c[1] / scale, d = c[2] / scale, one = 1 / scale;
        double *paid = s->paid + k * n, *sums = s->sums + k * (n + 1), *least = s->least + k * (n + 1);
        for (Py_ssize_t i = 0; i < n; i++) {
            const double u = s->u[i], off = s->z[i] * (a + u * (b + u * d)) - one;
            paid[i] = smaller(off * off + wider, 1.0);
        }
        double whole = 0.0, total = 0.0;
        for (Py_ssize_t i = 0; i < n; i++) {
            const double most = paid[i] * share[i];
            sums[i] = whole;
            least[i] = total;
            whole += paid[i];
            total += most;
        }
        sums[n] = whole;
        least[n] = total;
    }
}

/* _intersect_candidates for one pair; NULL if they do not meet. */
static Corner *corner_of(const Search *s, Py_ssize_t i, Py_ssize_t j)
{
    Corner *corner = s->corners + i * s->count + j;
    uint8_t *state = s->states + i * s->count + j;
    if (*state) return *state == NOWHERE ? NULL : corner;
    const double *p = s->coefficients + 3 * i, *q = s->coefficients + 3 * j;
    const double middle = 0.5 * (s->last[i] + s->first[j]), c = p[2] - q[2];
    const double a = p[0] - q[0] + middle * (p[1] - q[1] + middle * c), b = p[1] - q[1] + 2 * middle * c;
    const double root = sqrt(b * b - 4 * a * c), u = middle - 2 * a / (b + copysign(root, b));
    const double y = p[0] + u * (p[1] + u * p[2]), z = 1 / y, x = -u * z;
    *state = NOWHERE;
    if (!(y > 0 && x > s->bounds[0] && x < s->bounds[1] && z > s->bounds[2] && z < s->bounds[3])) return NULL;
    const double slope = p[1] + 2 * u * p[2], other = q[1] + 2 * u * q[2];
    *state = SOMEWHERE;
    corner->x = x;
    corner->z = z;
    corner->place = search_sorted(s->u, s->n, u);
    corner->ways[0] = y - u * slope;
    corner->ways[1] = -slope;
    corner->ways[2] = y - u * other;
    corner->ways[3] = -other;
    return corner;
}

/* Bounds of a turn, with what excludes most turns without an angle. */
typedef struct {
    double least, most, cosines[2], sines[2];
} Turn;

/* Whether a corner turns within bounds; its angles are known then. */
static int turns_within(Corner *c, uint8_t *state, const Turn *turn)
{
    const double *w = c->ways;
    if (*state == SOMEWHERE) {
        if (w[0] > 0 && w[2] > 0 && turn->most - turn->least < 3) {
            const double cosine = w[0] * w[2] + w[1] * w[3], sine = w[1] * w[2] - w[0] * w[3];
            const double slack = 1e-9 * (fabs(cosine) + fabs(sine));
            if (sine * turn->cosines[0] - cosine * turn->sines[0] < -slack) return 0;
            if (cosine * turn->sines[1] - sine * turn->cosines[1] < -slack) return 0;
        }
        c->before = atan2(w[1], w[0]);
        c->after = atan2(w[3], w[2]);
        *state = WITH_ANGLES;
    }
    return c->before - c->after >= turn->least && c->before - c->after <= turn->most;
}

/* Whether a corner of candidates i and j may be the first of a chain, or the last. */
static int may_begin(const Search *s, Py_ssize_t i, const Corner *c)
{
    const double place = (double)c->place, support = place - s->sums[i * (s->n + 1) + c->place];
    return support >= larger(LEAST_SUPPORT_SHARE * place, FEWEST_OUTER_POINTS);
}

static int may_end(const Search *s, Py_ssize_t j, const Corner *c)
{
    const double *sums = s->sums + j * (s->n + 1), behind = (double)(s->n - c->place);
    return behind - sums[s->n] + sums[c->place] >= larger(LEAST_SUPPORT_SHARE * behind, FEWEST_OUTER_POINTS);
}

/* Whether candidate b fits as a side between two corners. */
static int may_be_side(
    const Search *s, Py_ssize_t b, const Corner *start, const Corner *end, const double *side)
{
    const double *sums = s->sums + b * (s->n + 1), span = (double)(end->place - start->place);
    if (!(span > 0)) return 0;
    const double support = ((double)end->place - sums[end->place]) - ((double)start->place - sums[start->place]);
    if (!(support >= LEAST_SUPPORT_SHARE * span && support >= FEWEST_INNER_POINTS)) return 0;
    const double x = end->x - start->x, z = end->z - start->z, square = x * x + z * z;
    const double shortest = SIDE_LENGTH_SLACK * side[1], longest = side[2] / SIDE_LENGTH_SLACK;
    if (!(square > shortest * shortest && square < longest * longest)) return 0;
    if (!side[3]) return 1;
    const double chord = atan2(z, -x);
    return start->before - chord > LEAST_FACE_TURN && chord - end->after > LEAST_FACE_TURN;
}

typedef struct {
    double bound, cost;
    int32_t sides[MOST_SIDES];
} Chain;

static int compare_bounds(const void *a, const void *b)
{
    const double x = ((const Chain *)a)->bound, y = ((const Chain *)b)->bound;
    return (x > y) - (x < y);
}

static int compare_costs(const void *a, const void *b)
{
    const Chain *x = a, *y = b;
    if (x->cost != y->cost) return x->cost < y->cost ? -1 : 1;
    return compare_bounds(a, b);
}

/* _exact_costs of one chain of k sides. */
static double exact_cost(const Search *s, const Chain *chain, int k)
{
    Py_ssize_t ends[MOST_SIDES];
    double cost = 0.0;
    for (int j = 0; j < k; j++) {
        const double *sums = s->sums + chain->sides[j] * (s->n + 1);
        ends[j] = j < k - 1 ? corner_of(s, chain->sides[j], chain->sides[j + 1])->place : s->n;
        cost += sums[ends[j]] - sums[j ? ends[j - 1] : 0];
    }
    for (Py_ssize_t r = 0; r < s->runs; r++) {
        const double count = (double)s->run_count[r];
        if (!s->run_jumps[r] || RUN_COST + POINT_COST * count >= count) continue;
        int64_t i = s->run_first[r], stop = i + s->run_count[r];
        int side = 0;
        for (; i < stop; i++) {
            while (i >= ends[side]) side++;
            if (s->paid[chain->sides[side] * s->n + i] < 1) break;
        }
        if (i == stop) cost += RUN_COST + POINT_COST * count - count;
    }
    return cost;
}

/* A heap of the cheapest chains by their bounds, the dearest first. */
static void keep_cheapest(Chain *heap, int *count, const Chain *chain)
{
    int i;
    if (*count < MOST_CHAINS_COMPARED) {
        i = (*count)++;
        for (; i && heap[(i - 1) / 2].bound < chain->bound; i = (i - 1) / 2) heap[i] = heap[(i - 1) / 2];
    } else {
        if (!(chain->bound < heap[0].bound)) return;
        for (i = 0;;) {
            int child = 2 * i + 1;
            if (child + 1 < *count && heap[child + 1].bound > heap[child].bound) child++;
            if (child >= *count || heap[child].bound <= chain->bound) break;
            heap[i] = heap[child];
            i = child;
        }
    }
    heap[i] = *chain;
}

/* Chains that end with pairs of candidates of two layers: what they cost, and the pair before. */
typedef struct {
    Py_ssize_t rows, columns;
    double *cost; /* infinite where no chain is allowed */
    int32_t *before;
} Layer;

static double step_cost(const Search *s, Py_ssize_t i, Py_ssize_t j, const Corner *c)
{
    return s->least[i * (s->n + 1) + c->place] - s->least[j * (s->n + 1) + c->place];
}

/* cheapest_chains of one form into `found`, at most so many; how many, -1 without memory. */
static int find_chains(const Search *s, const double *form, int k, int most, Chain *found)
{
    /* Rows of the form: kinds as bits, shortest, longest, bead, least and most turn into the next. */
    int32_t *members = malloc((size_t)(s->count * k) * sizeof(int32_t));
    Chain *heap = malloc(MOST_CHAINS_COMPARED * sizeof(Chain));
    Py_ssize_t sizes[MOST_SIDES] = {0};
    int32_t *layer[MOST_SIDES];
    Layer pairs[MOST_SIDES];
    int heaped = 0, number = members && heap ? 0 : -1;
    memset(pairs, 0, sizeof pairs);
    for (int j = 0; number == 0 && j < k; j++) {
        layer[j] = members + s->count * j;
        for (Py_ssize_t i = 0; i < s->count; i++)
            if ((int)form[FORM_VALUES * j] >> s->kind[i] & 1) layer[j][sizes[j]++] = (int32_t)i;
    }
    for (int j = 0; number == 0 && j < k - 1; j++) {
        const double *side = form + FORM_VALUES * j;
        const size_t room = (size_t)(sizes[j] * sizes[j + 1]);
        Layer *own = &pairs[j];
        const Turn turn = {side[4], side[5], {cos(side[4]), cos(side[5])}, {sin(side[4]), sin(side[5])}};
        own->cost = malloc((room + 1) * (sizeof(double) + sizeof(int32_t)));
        if (!own->cost) {
            number = -1;
            break;
        }
        own->before = (int32_t *)(own->cost + room + 1);
        for (Py_ssize_t b = 0; b < sizes[j]; b++)
            for (Py_ssize_t c = 0; c < sizes[j + 1]; c++) {
                const Py_ssize_t own_b = layer[j][b], own_c = layer[j + 1][c];
                double *cost = own->cost + b * sizes[j + 1] + c;
                *cost = INFINITY;
                Corner *corner = corner_of(s, own_b, own_c);
                uint8_t *state = s->states + own_b * s->count + own_c;
                if (!corner || !turns_within(corner, state, &turn)) continue;
                if (j == 0 && !may_begin(s, own_b, corner)) continue;
                if (j == k - 2 && !may_end(s, own_c, corner)) continue;
                const double step = step_cost(s, own_b, own_c, corner);
                if (j == 0) *cost = step;
                double cheapest = INFINITY;
                for (Py_ssize_t a = 0; j && a < sizes[j - 1]; a++) {
                    const double before = pairs[j - 1].cost[a * sizes[j] + b];
                    if (!(before < INFINITY)) continue;
                    if (j < k - 2 && !(before < cheapest)) continue;
                    if (!may_be_side(s, own_b, corner_of(s, layer[j - 1][a], own_b), corner, side)) continue;
                    if (j < k - 2) {
                        cheapest = before;
                        *cost = before + step;
                        own->before[b * sizes[j + 1] + c] = (int32_t)a;
                        continue;
                    }
                    Chain chain;
                    chain.bound = before + step + s->least[own_c * (s->n + 1) + s->n];
                    if (heaped == MOST_CHAINS_COMPARED && !(chain.bound < heap[0].bound)) continue;
                    Py_ssize_t at = a, next = b;
                    chain.sides[k - 1] = (int32_t)own_c;
                    chain.sides[k - 2] = (int32_t)own_b;
                    for (int i = k - 3; i >= 0; i--) {
                        chain.sides[i] = layer[i][at];
                        if (!i) break;
                        const Py_ssize_t previous = pairs[i].before[at * sizes[i + 1] + next];
                        next = at;
                        at = previous;
                    }
                    keep_cheapest(heap, &heaped, &chain);
                }
            }
    }
    qsort(heap, (size_t)heaped, sizeof(Chain), compare_bounds);
    double cheapest = INFINITY;
    int exact = 0;
    for (int i = 0; number == 0 && i < heaped && heap[i].bound < cheapest + RIVAL_COST_MARGIN; i++) {
        const int32_t *sides = heap[i].sides;
        const double across = corner_of(s, sides[0], sides[1])->before - corner_of(s, sides[k - 2], sides[k - 1])->after;
        if (!(across >= form[6] && across <= form[FORM_VALUES + 6])) continue;
        heap[exact] = heap[i];
        heap[exact].cost = exact_cost(s, &heap[exact], k);
        cheapest = smaller(cheapest, heap[exact++].cost);
    }
    qsort(heap, (size_t)exact, sizeof(Chain), compare_costs);
    for (int i = 0; i < exact && number < most && heap[i].cost < cheapest + RIVAL_COST_MARGIN; i++) {
        int distinct = 1;
        for (int m = 0; m < number && distinct; m++) {
            double apart = 0.0;
            for (int j = 0; j < k - 1; j++) {
                const Corner *p = corner_of(s, heap[i].sides[j], heap[i].sides[j + 1]);
                const Corner *q = corner_of(s, found[m].sides[j], found[m].sides[j + 1]);
                apart = larger(apart, larger(fabs(p->x - q->x), fabs(p->z - q->z)));
            }
            distinct = apart > LEAST_DISTANCE_OF_RIVALS;
        }
        if (distinct) found[number++] = heap[i];
    }
    for (int j = 0; j < k - 1; j++) free(pairs[j].cost);
    free(heap);
    free(members);
    return number;
}

static void free_search(PyObject *capsule)
{
    Search *s = PyCapsule_GetPointer(capsule, "search");
    if (s) {
        free(s->paid);
        free(s->corners);
        free(s->states);
    }
    free(s);
}

static PyObject *begin_search(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char letters[] = "ddiddddiib";
    Py_buffer v[10];
    (void)self;
    if (given != 11) return PyErr_Format(PyExc_TypeError, "begin_search takes 11 arguments");
    const double tolerance = PyFloat_AsDouble(args[10]);
    if (PyErr_Occurred() || open_arrays(letters, args, v) < 0) return NULL;
    const Py_ssize_t n = count_of(&v[0]), count = count_of(&v[2]), runs = count_of(&v[7]);
    int sound = n > 0 && count > 0 && runs > 0 && count_of(&v[1]) == n && count_of(&v[3]) == count
                && count_of(&v[4]) == 3 * count && count_of(&v[5]) == count && count_of(&v[6]) == count
                && count_of(&v[8]) == runs && count_of(&v[9]) == runs;
    const int64_t *kind = v[2].buf, *first = v[7].buf, *length = v[8].buf;
    int64_t next = 0;
    for (Py_ssize_t i = 0; sound && i < count; i++) sound = kind[i] >= 0 && kind[i] < 30;
    for (Py_ssize_t r = 0; sound && r < runs; r++) {
        sound = first[r] == next && length[r] > 0;
        next += length[r];
    }
    if (!sound || next != n) {
        close_arrays(letters, v);
        return PyErr_Format(PyExc_ValueError, "arrays of a search do not match");
    }
    /* One piece of memory; what Python handed over is copied, for it may not live as long. */
    const size_t points = (size_t)n, sides = (size_t)count, own_runs = (size_t)runs;
    const size_t sizes[] = {sides * points, sides * (points + 1), sides * (points + 1), points, points,
                            3 * sides, sides, sides, sides, own_runs, own_runs, own_runs};
    size_t total = 0;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) total += sizes[i];
    double *memory = malloc(total * sizeof(double));
    Corner *corners = malloc(sides * sides * sizeof(Corner));
    uint8_t *states = calloc(sides * sides, 1);
    Search *s = calloc(1, sizeof(Search));
    PyObject *capsule = NULL;
    if (memory && corners && states && s) {
        double *to = memory + sizes[0] + sizes[1] + sizes[2];
        s->n = n;
        s->count = count;
        s->runs = runs;
        s->paid = memory;
        s->sums = memory + sizes[0];
        s->least = s->sums + sizes[1];
        s->u = to;
        to = put(to, v[0].buf, points);
        s->z = to;
        to = put(to, v[1].buf, points);
        s->coefficients = to;
        to = put(to, v[4].buf, 3 * sides);
        s->first = to;
        to = put(to, v[5].buf, sides);
        s->last = to;
        to = put(to, v[6].buf, sides);
        s->kind = (int64_t *)to;
        to = put(to, v[2].buf, sides);
        s->run_first = (int64_t *)to;
        to = put(to, v[7].buf, own_runs);
        s->run_count = (int64_t *)to;
        to = put(to, v[8].buf, own_runs);
        s->run_jumps = (uint8_t *)to;
        memcpy(to, v[9].buf, own_runs);
        s->corners = corners;
        s->states = states;
        prepare(s, v[3].buf, tolerance);
        capsule = PyCapsule_New(s, "search", free_search);
    } else {
        PyErr_NoMemory();
    }
    if (!capsule) {
        free(memory);
        free(corners);
        free(states);
        free(s);
    }
    close_arrays(letters, v);
    return capsule;
}

static PyObject *cheapest_chains(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char letters[] = "d";
    Py_buffer v[1];
    (void)self;
    if (given != 3) return PyErr_Format(PyExc_TypeError, "cheapest_chains takes 3 arguments");
    const Search *s = PyCapsule_GetPointer(args[0], "search");
    const long most = PyLong_AsLong(args[2]);
    if (PyErr_Occurred() || open_arrays(letters, args + 1, v) < 0) return NULL;
    const Py_ssize_t k = count_of(&v[0]) / FORM_VALUES;
    PyObject *list = NULL;
    Chain found[MOST_CHAINS_COMPARED];
    if (k < 3 || k > MOST_SIDES || count_of(&v[0]) != k * FORM_VALUES || most < 0 || most > MOST_CHAINS_COMPARED) {
        PyErr_SetString(PyExc_ValueError, "arrays of a form do not match");
    } else {
        const int number = find_chains(s, v[0].buf, (int)k, (int)most, found);
        list = number < 0 ? PyErr_NoMemory() : PyList_New(0);
        for (int i = 0; list && i < number; i++) {
            PyObject *sides = PyList_New(k), *corners = PyList_New(2 * (k - 1));
            for (Py_ssize_t j = 0; sides && corners && j < k; j++) {
                PyList_SetItem(sides, j, PyLong_FromLong(found[i].sides[j]));
                if (j == k - 1) break;
                const Corner *corner = corner_of(s, found[i].sides[j], found[i].sides[j + 1]);
                PyList_SetItem(corners, 2 * j, PyFloat_FromDouble(corner->x));
                PyList_SetItem(corners, 2 * j + 1, PyFloat_FromDouble(corner->z));
            }
            PyObject *one = sides && corners ? Py_BuildValue("(dNN)", found[i].cost, sides, corners) : NULL;
            if (!one || PyList_Append(list, one) < 0) Py_CLEAR(list);
            Py_XDECREF(one);
        }
    }
    close_arrays(letters, v);
    return list;
}

/* ---- errors of corners: groove/shape.py ---- */

enum { MOST_PULLS = 32 };

/* Nothing is pulled so many decays away, and its exponential is finite. */
static const double LARGEST_EXPONENT = 300.0;
static const double LARGEST_LOG_ODDS = 60.0;
static const double Pi = 3.14159265358979323846;

/* A fit as Python holds it, and the points it rests on. */
typedef struct {
    Py_ssize_t n, k;
    const double *x, *z, *along, *residuals, *places, *corners, *sigmas, *middles, *straight;
    const double *matrix, *rhs, *inverse, *weight;
    const int64_t *edges, *counts;
    const uint8_t *keep, *curved;
    const Curve *curves;
    double inflation;
    Side sides[MOST_SIDES];
    double *work; /* twice n values */
    uint8_t *on;
} Fitted;

/* What is tried of a pull: how far, and the lengths of its shapes. */
typedef struct {
    Py_ssize_t pulls, reaches, decays;
    const double *pull, *reach, *decay;
    const double *weights;
} Tried;

static double side_noise_variance(const Fitted *f, Py_ssize_t j)
{
    const double lost = noise_share_in_fit(2 + f->curved[j], f->inflation, (double)f->counts[j]);
    return f->sigmas[j] * f->sigmas[j] / (1 - lost);
}

static double median_high(const double *v, Py_ssize_t n, double *work)
{
    memcpy(work, v, (size_t)n * sizeof(double));
    return select_rank(work, n, n / 2);
}

static double median_of_few(const double *v, Py_ssize_t n)
{
    double work[MOST_SIDES];
    const double high = median_high(v, n, work);
    return n % 2 ? high : 0.5 * (high + select_rank(work, n, n / 2 - 1));
}

static double sine_with_ray(const Curve *c, double s)
{
    const double slope = curve_slope(c, s), scale = 1 / hypot(1.0, slope);
    const double tx = (c->tx + slope * c->tz) * scale, tz = (c->tz - slope * c->tx) * scale;
    double x, z;
    point_on_curve(c, s, &x, &z);
    return larger(fabs(x * tz - z * tx) / hypot(x, z), LEAST_RAY_SINE);
}

static void patch_sigmas(const Fitted *f, double *found)
{
    double along[MOST_SIDES];
    for (Py_ssize_t i = 0; i < f->k; i++) along[i] = f->sigmas[i] / sine_with_ray(&f->curves[i], f->middles[i]);
    const double usual = median_of_few(along, f->k);
    for (Py_ssize_t i = 0; i < f->k; i++) {
        double square = 0.0, close = 0.0, off = 0.0;
        for (Py_ssize_t p = f->edges[i] + CORNER_POINTS; p < f->edges[i + 1] - CORNER_POINTS; p++) {
            const double size = fabs(f->residuals[p]);
            if (!(size < PATCH_REACH)) continue;
            close += 1;
            off += size > PATCH_SIGMAS * f->sigmas[i];
            square += size * size;
        }
        found[i] = 0.0;
        if (close < FEWEST_PATCH_POINTS) continue;
        if (off / close > PATCHED_SHARE || along[i] > ROUGH_SIDE_FACTOR * usual) found[i] = sqrt(square / close);
    }
}

static void mark_points_on_sides(const Fitted *f)
{
    const double close = OUTLIER_SIGMAS * larger(median_of_few(f->sigmas, f->k), LEAST_NOISE);
    for (Py_ssize_t i = 0; i < f->n; i++) f->on[i] = f->keep[i] || fabs(f->residuals[i]) < close;
}

/* end_of_support of n points from the first on, or from the last back. */
static Py_ssize_t end_of_support(const uint8_t *on, Py_ssize_t n, int step)
{
    for (Py_ssize_t i = n - 1; i >= 0; i--) {
        int near = 0;
        for (Py_ssize_t p = i - SUPPORT_NEIGHBOURS; p <= i + SUPPORT_NEIGHBOURS; p++)
            near += p >= 0 && p < n && on[step * p];
        if (near > SUPPORT_NEIGHBOURS) return i + 1;
    }
    return 0;
}

static void gaps_beside_corners(const Fitted *f, double (*found)[2])
{
    mark_points_on_sides(f);
    for (Py_ssize_t i = 0; i < f->k - 1; i++)
        for (int j = 0; j < 2; j++) {
            const Py_ssize_t a = f->edges[i + j], n = f->edges[i + j + 1] - a, from = j ? a + n - 1 : a;
            const int step = j ? -1 : 1;
            Py_ssize_t dense = end_of_support(f->on + from, n, step);
            found[i][j] = INFINITY;
            for (Py_ssize_t p = 0; p < (dense ? dense : n); p++)
                if (f->on[from + step * p])
                    found[i][j] = smaller(found[i][j], fabs(f->along[from + step * p] - f->places[2 * i + j]));
        }
}

/* A flank of a notch as groove/shape.py has it. */
typedef struct {
    double cx, cz, tx, tz, limit, square;
    double met[MOST_PULLS], bearing[MOST_PULLS];
} Flank;

/* Takes cosines and exponentials of the points from `begin` to `end` of a notch's region. */
static void take_shapes(const Tried *tried, double *shapes, Py_ssize_t count, Py_ssize_t begin, Py_ssize_t end)
{
    const double *inward = shapes;
    for (Py_ssize_t r = 0; r < tried->reaches + tried->decays; r++) {
        double *one = shapes + (2 + 2 * r) * count, *other = one + count;
        const int ends = r < tried->reaches;
        const double scale = ends ? Pi / tried->reach[r] : 1 / tried->decay[r - tried->reaches];
        for (Py_ssize_t i = begin; i < end; i++) {
            const double angle = inward[i] * scale;
            if (ends) {
                one[i] = cos(angle);
                other[i] = sin(angle);
            } else {
                other[i] = exp(smaller(larger(angle, -LARGEST_EXPONENT), LARGEST_EXPONENT));
                one[i] = 1 / other[i];
            }
        }
    }
}

/* What the points pay for each pull and shape, into `cost`, infinite if it is more than `most`; 0 if face
   and flanks are parallel. `taken` says which points of each flank have their cosines. */
static int pull_costs(
    const Fitted *f, const Tried *tried, const Curve *face, const double places[2], double limit,
    Flank flanks[2], Py_ssize_t a, Py_ssize_t b, const double *u, double *const shapes[2], Py_ssize_t taken[2],
    double most, double *cost)
{
    const Py_ssize_t kinds = tried->reaches + tried->decays, count = b - a;
    for (int w = 0; w < 2; w++) {
        Flank *flank = &flanks[w];
        double x, z;
        point_on_curve(face, places[w], &x, &z);
        const double slope = curve_slope(face, places[w]), scale = 1 / hypot(1.0, slope);
        const double tx = (face->tx + slope * face->tz) * scale, tz = (face->tz - slope * face->tx) * scale;
        const double cross = flank->tx * tz - flank->tz * tx;
        if (fabs(cross) < LEAST_TURN_SINE) return 0;
        const double met = (x - flank->cx) * tz - (z - flank->cz) * tx;
        for (Py_ssize_t p = 0; p < tried->pulls; p++) {
            flank->met[p] = (met + tried->pull[p] * (flank->cx / flank->cz * tz - tx)) / cross;
            flank->bearing[p] = -(flank->cx + flank->met[p] * flank->tx) / (flank->cz + flank->met[p] * flank->tz);
        }
    }
    double *own = f->work + f->n;
    for (Py_ssize_t i = 0; i < count; i++) {
        const double s = position_along_chord(face, f->x[a + i], f->z[a + i]);
        const double d = (f->x[a + i] - face->cx) * face->tz - (f->z[a + i] - face->cz) * face->tx;
        const double off = (d - curve_height(face, s)) / limit;
        own[i] = smaller(off * off, 1.0);
    }
    for (Py_ssize_t p = 0; p < tried->pulls; p++) {
        if (!(flanks[0].bearing[p] < flanks[1].bearing[p])) {
            for (Py_ssize_t r = 0; r < kinds; r++) cost[p * kinds + r] = INFINITY;
            continue;
        }
        const Py_ssize_t first = search_sorted(u + a, count, flanks[0].bearing[p]);
        const Py_ssize_t last = search_sorted(u + a, count, flanks[1].bearing[p]);
        if (first > taken[0]) {
            take_shapes(tried, shapes[0], count, taken[0], first);
            taken[0] = first;
        }
        if (last < taken[1]) {
            take_shapes(tried, shapes[1], count, last, taken[1]);
            taken[1] = last;
        }
        double face_pays = 0.0;
        for (Py_ssize_t i = first; i < last; i++) face_pays += own[i];
        for (Py_ssize_t r = 0; r < kinds; r++) {
            double total = face_pays;
            const int ends = r < tried->reaches;
            const double length = ends ? tried->reach[r] : tried->decay[r - tried->reaches];
            for (int w = 0; w < 2 && total <= most; w++) {
                const Flank *flank = &flanks[w];
                const double *inward = shapes[w], *behind = inward + count;
                const double *one = behind + count + 2 * r * count, *other = one + count;
                const Py_ssize_t begin = w ? last : 0, end = w ? count : first;
                /* Sums of angles and of exponents: cosines and exponentials are taken only once. */
                const double ratio = flank->met[p] / length;
                const double angle = ends ? ratio : smaller(larger(ratio, -LARGEST_EXPONENT), LARGEST_EXPONENT);
                const double turn_1 = ends ? cos(Pi * angle) : exp(angle), turn_2 = ends ? sin(Pi * angle) : exp(-angle);
                const double fuzz = PULL_SHAPE_SIGMA * OUTLIER_SIGMAS / flank->limit * tried->pull[p];
                double product = 1.0, logs = 0.0, pays = 0.0;
                for (Py_ssize_t i = begin; i < end; i++) {
                    double share;
                    if (ends)
                        share = flank->met[p] - inward[i] >= length ? 0.0 : 0.5 + 0.5 * (turn_1 * one[i] + turn_2 * other[i]);
                    else
                        share = 2 / (turn_1 * one[i] + turn_2 * other[i]);
                    const double away = (behind[i] + flank->square * tried->pull[p] * share) / flank->limit;
                    const double fuzzy = fuzz * share * (fuzz * share);
                    pays += smaller(away * away / (1 + fuzzy), 1.0);
                    product *= 1 + fuzzy;
                    if (product > 1e200) {
                        logs += log(product);
                        product = 1.0;
                    }
                    if (total + pays > most) break;
                }
                total += pays + (logs + log(product)) / (OUTLIER_SIGMAS * OUTLIER_SIGMAS);
            }
            cost[p * kinds + r] = total <= most ? total : INFINITY;
        }
    }
    return 1;
}

typedef struct {
    double probability, inward[2], sigma[2];
} Pull;

/* find_pull; -1 without memory. */
static int find_pull(const Fitted *f, const Tried *tried, const double *u, Py_ssize_t k, Pull *found)
{
    const Py_ssize_t kinds = tried->reaches + tried->decays, cells = tried->pulls * kinds;
    const Curve *face = &f->curves[k];
    const double places[2] = {f->places[2 * (k - 1) + 1], f->places[2 * k]}, none[2] = {0.0, 0.0};
    double limits[MOST_SIDES];
    memset(found, 0, sizeof *found);
    for (Py_ssize_t j = 0; j < f->k; j++) limits[j] = OUTLIER_SIGMAS * larger(f->sigmas[j], LEAST_NOISE);
    const double flat = limits[k], sag = -face->c2 * (places[1] - places[0]) * (places[1] - places[0]) / 4;
    limits[k] = larger(flat, FACE_BLUNTNESS * fabs(sag));
    Flank flanks[2];
    Py_ssize_t range[2];
    for (int w = 0; w < 2; w++) {
        const Curve *curve = &f->curves[w ? k + 1 : k - 1];
        const double s = w ? f->places[2 * k + 1] : f->places[2 * (k - 1)], sign = w ? -1.0 : 1.0;
        const double slope = curve_slope(curve, s), scale = sign / hypot(1.0, slope);
        double x, z;
        point_on_curve(curve, s - sign * NOTCH_REGION_LENGTH, &x, &z);
        range[w] = search_sorted(u, f->n, -x / z);
        Flank *flank = &flanks[w];
        point_on_curve(curve, s, &flank->cx, &flank->cz);
        flank->tx = (curve->tx + slope * curve->tz) * scale;
        flank->tz = (curve->tz - slope * curve->tx) * scale;
        flank->limit = limits[w ? k + 1 : k - 1];
        flank->square = fabs(flank->cx * flank->tz - flank->cz * flank->tx) / hypot(flank->cx, flank->cz);
    }
    const Py_ssize_t a = range[0], b = range[1] > a ? range[1] : a, count = b - a;
    double *memory = malloc((size_t)(2 * (2 + 2 * kinds) * count + 11 * cells + 1) * sizeof(double));
    if (!memory) return -1;
    double *shapes[2] = {memory, memory + (2 + 2 * kinds) * count}, *costs = memory + 2 * (2 + 2 * kinds) * count;
    for (int w = 0; w < 2; w++) {
        const Curve *curve = &f->curves[w ? k + 1 : k - 1];
        const Flank *flank = &flanks[w];
        for (Py_ssize_t i = 0; i < count; i++) {
            const double x = f->x[a + i], z = f->z[a + i], s = position_along_chord(curve, x, z);
            const double inward = (flank->cz * x - flank->cx * z) / (flank->tx * z - flank->tz * x);
            shapes[w][i] = inward;
            shapes[w][count + i] = (x - curve->cx) * curve->tz - (z - curve->cz) * curve->tx - curve_height(curve, s);
        }
    }
    double now = 0.0;
    Py_ssize_t owner = 0, lines = 0, faced = 0;
    int64_t *on_face = (int64_t *)f->work; /* its points */
    for (Py_ssize_t i = a; i < b; i++) {
        while (i >= f->edges[owner + 1]) owner++;
        const double off = f->residuals[i] / limits[owner];
        now += smaller(off * off, 1.0);
        if (owner == k) on_face[faced++] = i;
    }
    double met[11][2][MOST_PULLS];
    Py_ssize_t taken[2] = {0, count};
    /* What pays so much more weighs nothing. */
    const double most = now + LARGEST_LOG_ODDS * 2 * f->inflation / (OUTLIER_SIGMAS * OUTLIER_SIGMAS);
    for (int line = 0; line < (sag > flat && faced >= FEWEST_FACE_POINTS ? 11 : 1); line++) {
        static const double FACE_POINT_SHARES[5] = {0.15, 0.35, 0.5, 0.65, 0.85};
        Curve own = *face;
        if (line) {
            int first = 0, second = line; /* the pairs of five points in their order */
            while (second > 4 - first) second -= 4 - first++;
            second += first;
            const int64_t p = on_face[(Py_ssize_t)rint(FACE_POINT_SHARES[first] * (double)(faced - 1))];
            const int64_t q = on_face[(Py_ssize_t)rint(FACE_POINT_SHARES[second] * (double)(faced - 1))];
            const double dx = f->x[q] - f->x[p], dz = f->z[q] - f->z[p], length = hypot(dx, dz);
            const Curve straight = {f->x[p], f->z[p], dx / length, dz / length, 0.0, 0.0, 0.0, 0.0};
            own = straight;
        }
        if (!pull_costs(f, tried, &own, line ? none : places, line ? flat : limits[k], flanks, a, b, u, shapes,
                        taken, most, costs + lines * cells))
            continue;
        for (int w = 0; w < 2; w++) memcpy(met[lines][w], flanks[w].met, sizeof flanks[w].met);
        lines++;
    }
    double total = 0.0, mean[2] = {0.0, 0.0}, square[2] = {0.0, 0.0}, allowed = 0.0;
    for (Py_ssize_t c = 0; c < cells; c++) allowed += tried->weights[c];
    for (Py_ssize_t line = 0; line < lines; line++)
        for (Py_ssize_t c = 0; c < cells; c++) {
            if (tried->weights[c] == 0) continue;
            const double cost = costs[line * cells + c];
            const double weight = tried->weights[c] * exp((now - cost) * OUTLIER_SIGMAS * OUTLIER_SIGMAS / 2 / f->inflation);
            if (weight == 0) continue;
            total += weight;
            for (int w = 0; w < 2; w++) {
                const double inward = met[line][w][c / kinds];
                mean[w] += weight * inward;
                square[w] += weight * inward * inward;
            }
        }
    free(memory);
    const double odds = lines ? PULL_PRIOR_ODDS * total / ((double)lines * allowed) : 0.0;
    if (!(odds >= 1e-4)) return 0;
    found->probability = odds / (1 + odds);
    for (int w = 0; w < 2; w++) {
        found->inward[w] = mean[w] / total;
        found->sigma[w] = sqrt(larger(square[w] / total - found->inward[w] * found->inward[w], 0.0));
    }
    return 0;
}

static void tangent_at(const Curve *c, double s, double *tx, double *tz)
{
    const double slope = curve_slope(c, s), scale = 1 / hypot(1.0, slope);
    *tx = (c->tx + slope * c->tz) * scale;
    *tz = (c->tz - slope * c->tx) * scale;
}

/* _shape_sigmas, and what a pull moves in corner_estimates; 0 without memory. */
static int shape_errors(const Fitted *f, const Tried *tried, const double *u, double shift[][2], double sigma[][2])
{
    double gaps[MOST_SIDES][2], patches[MOST_SIDES];
    const Py_ssize_t corners = f->k - 1;
    patch_sigmas(f, patches);
    gaps_beside_corners(f, gaps);
    for (Py_ssize_t i = 0; i < corners; i++)
        for (int j = 0; j < 2; j++) {
            const Py_ssize_t side = i + j;
            double unseen = 0.0;
            if (side > 0 && side < corners) {
                const double length = fabs(f->places[2 * side] - f->places[2 * (side - 1) + 1]);
                unseen = sqrt(smaller(gaps[i][j] / larger(length, 1e-9), 1.0));
            }
            shift[i][j] = 0.0;
            sigma[i][j] = hypot(patches[side], UNSEEN_SIDE_SLOPE * larger(gaps[i][j] - MEETING_REACH, 0.0) * unseen);
        }
    for (Py_ssize_t k = 1; k < corners; k++) {
        if (!f->sides[k].bead) continue;
        Pull pull;
        if (find_pull(f, tried, u, k, &pull) < 0) return 0;
        const double probability = PULL_PROBABILITY * pull.probability;
        const double length = f->places[2 * k] - f->places[2 * (k - 1) + 1];
        const double bow = fabs(f->curves[k].c2) * (length * length) / 4;
        for (int i = 0; i < 2; i++) { /* a pull, as heights of the face */
            const Py_ssize_t c = k - 1 + i;
            double ax, az, bx, bz;
            tangent_at(&f->curves[c], f->places[2 * c], &ax, &az);
            tangent_at(&f->curves[c + 1], f->places[2 * c + 1], &bx, &bz);
            const double slope = curve_slope(&f->curves[k], f->places[2 * c + 1 - i]);
            const double lower = (ax * bz - az * bx) * hypot(1.0, slope), inward = pull.inward[i];
            const double square = probability * (pull.sigma[i] * pull.sigma[i] + inward * inward)
                                  - probability * inward * (probability * inward);
            shift[c][1 - i] = probability * inward * lower;
            sigma[c][1 - i] = hypot(hypot(sigma[c][1 - i], sqrt(square) * lower), FACE_END_SHARE * bow);
        }
    }
    return 1;
}

/* coefficient_covariances of one side, added with a weight. */
static void add_sandwich(
    const double *inverse, const double *meat, const double *weight, const Side *side, double share, double *total)
{
    const double spread[2] = {side->bend, side->twist};
    double inner[16], half[16] = {0.0};
    memcpy(inner, meat, sizeof inner);
    for (int a = 0; a < 2; a++) {
        const double doubt = weight[2 + a] < FIXED_WEIGHT ? weight[2 + a] * spread[a] : 0.0;
        inner[5 * (2 + a)] += doubt * doubt;
    }
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < 4; b++)
            for (int c = 0; c < 4; c++) half[4 * a + b] += inverse[4 * a + c] * inner[4 * c + b];
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < 4; b++)
            for (int c = 0; c < 4; c++) total[4 * a + b] += share * half[4 * a + c] * inverse[4 * c + b];
}

/* _coefficient_covariances of one side; 0 if its equations are singular. */
static int coefficient_covariance(const Fitted *f, Py_ssize_t j, double total[16])
{
    const Side *side = &f->sides[j];
    const Curve *curve = &f->curves[j];
    const double variance = side_noise_variance(f, j), *weight = f->weight + 4 * j;
    const double powers[4] = {1.0, SCALING_LENGTH, SCALING_LENGTH * SCALING_LENGTH,
                              SCALING_LENGTH * SCALING_LENGTH * SCALING_LENGTH};
    const double here[4] = {curve->c0, curve->c1, curve->c2, curve->c3};
    double meat[16], share = 0.0;
    for (int i = 0; i < 16; i++) meat[i] = f->inflation * variance * f->matrix[16 * j + i];
    memset(total, 0, 16 * sizeof(double));
    if (f->straight && side->bend > 0)
        share = 1 / (1 + exp(f->curved[j] ? -f->straight[j] : f->straight[j]));
    add_sandwich(f->inverse + 16 * j, meat, weight, side, 1 - share, total);
    if (f->straight) {
        double other[4] = {0.0, 0.0, FIXED_WEIGHT, FIXED_WEIGHT}, matrix[16], inverse[16], away[4];
        const double spread[2] = {side->bend, side->twist}, noted = larger(f->sigmas[j], LEAST_NOISE);
        for (int a = 0; a < 2; a++)
            if (side->bend > 0 && !f->curved[j] && spread[a] > 0)
                other[2 + a] = f->inflation * noted * noted / (spread[a] * spread[a]);
        memcpy(matrix, f->matrix + 16 * j, sizeof matrix);
        for (int a = 0; a < 4; a++) matrix[5 * a] += other[a];
        if (!invert(matrix, inverse)) return 0;
        for (int a = 0; a < 4; a++) {
            double there = 0.0;
            for (int b = 0; b < 4; b++) {
                const double expected = b == 2 && other[b] < FIXED_WEIGHT ? other[b] * side->expected_bend : 0.0;
                there += inverse[4 * a + b] * (f->rhs[4 * j + b] + expected);
            }
            away[a] = there - powers[a] * here[a];
        }
        add_sandwich(inverse, meat, other, side, share, total);
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < 4; b++) total[4 * a + b] += share * away[a] * away[b];
    }
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < 4; b++) total[4 * a + b] /= powers[a] * powers[b];
    return 1;
}

/* corner_estimates into corners and covariance; 1 if it is done, 0 if it is singular, -1 without memory. */
static int estimate_corners(const Fitted *f, const Tried *tried, const double *u, double *corners, double *covariance)
{
    const Py_ssize_t k = f->k, size = 2 * k;
    double jacobian[2 * MOST_SIDES][4 * MOST_SIDES], shift[MOST_SIDES][2], sigma[MOST_SIDES][2];
    memset(jacobian, 0, sizeof jacobian);
    for (Py_ssize_t i = 0; i < k - 1; i++) {
        double t[2][2], w[2];
        for (int j = 0; j < 2; j++) {
            const double s = f->places[2 * i + j];
            tangent_at(&f->curves[i + j], s, &t[j][0], &t[j][1]);
            /* Heights count along the chord's normal, 1 / cos of the slope farther. */
            w[j] = 1.0 / hypot(1.0, curve_slope(&f->curves[i + j], s));
        }
        const double det = t[0][0] * t[1][1] - t[0][1] * t[1][0];
        for (int v = 0; v < 2; v++)
            for (int j = 0; j < 2; j++) {
                const double s = f->places[2 * i + j], factor = (j ? t[0][v] : -t[1][v]) * w[j] / det;
                double *row = jacobian[2 * i + v] + 4 * (i + j);
                row[0] = factor;
                row[1] = factor * s;
                row[2] = factor * (s * s);
                row[3] = factor * (s * s * s);
            }
    }
    for (int end = 0; end < 2; end++) {
        const Py_ssize_t side = end ? k - 1 : 0, corner = end ? k - 2 : 0;
        const double s = f->places[2 * corner + end], slope = curve_slope(&f->curves[side], s);
        const double turned = -1.0 / (1.0 + slope * slope);
        const double bend = turned * (2 * f->curves[side].c2 + 6 * s * f->curves[side].c3);
        double *row = jacobian[2 * k - 2 + end];
        row[4 * side + 1] = turned;
        row[4 * side + 2] = 2 * s * turned;
        row[4 * side + 3] = 3 * s * s * turned;
        for (Py_ssize_t c = 0; c < 4 * k; c++)
            row[c] += bend * (f->curves[side].tx * jacobian[2 * corner][c] + f->curves[side].tz * jacobian[2 * corner + 1][c]);
    }
    memset(covariance, 0, (size_t)(size * size) * sizeof(double));
    for (Py_ssize_t j = 0; j < k; j++) {
        double own[16];
        if (!coefficient_covariance(f, j, own)) return 0;
        for (Py_ssize_t a = 0; a < size; a++) {
            double half[4] = {0.0};
            const double *row = jacobian[a] + 4 * j;
            if (row[0] == 0 && row[1] == 0) continue;
            for (int c = 0; c < 4; c++)
                for (int d = 0; d < 4; d++) half[d] += row[c] * own[4 * c + d];
            for (Py_ssize_t b = 0; b < size; b++)
                for (int d = 0; d < 4; d++) covariance[a * size + b] += half[d] * jacobian[b][4 * j + d];
        }
    }
    if (!shape_errors(f, tried, u, shift, sigma)) return -1;
    memcpy(corners, f->corners, (size_t)(2 * (k - 1)) * sizeof(double));
    for (Py_ssize_t i = 0; i < k - 1; i++)
        for (int j = 0; j < 2; j++) {
            if (sigma[i][j] == 0) continue;
            const double move[2] = {jacobian[2 * i][4 * (i + j)], jacobian[2 * i + 1][4 * (i + j)]};
            for (int a = 0; a < 2; a++) {
                corners[2 * i + a] += shift[i][j] * move[a];
                for (int b = 0; b < 2; b++)
                    covariance[(2 * i + a) * size + 2 * i + b] += sigma[i][j] * sigma[i][j] * move[a] * move[b];
            }
        }
    return 1;
}

static PyObject *corner_estimates(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char letters[] = "ddddddddbibddddidddddddDD";
    enum {
        X, Z, CURVE, PLACE, CORNER, ALONG, RESIDUAL, SIGMA, KEEP, EDGE, CURVED, MATRIX, RHS, INVERSE,
        WEIGHT, COUNT, MIDDLE, STRAIGHT, PULL, REACH, DECAY, SHARE, MODEL, ESTIMATE, COVARIANCE, ARRAYS
    };
    Py_buffer v[ARRAYS];
    (void)self;
    if (given != ARRAYS + 1) return PyErr_Format(PyExc_TypeError, "corner_estimates takes 26 arguments");
    const double inflation = PyFloat_AsDouble(args[ARRAYS]);
    if (PyErr_Occurred() || open_arrays(letters, args, v) < 0) return NULL;
    const Py_ssize_t n = count_of(&v[X]), k = count_of(&v[CURVE]) / SIDE_VALUES, straight = count_of(&v[STRAIGHT]);
    const Tried tried = {count_of(&v[PULL]), count_of(&v[REACH]), count_of(&v[DECAY]), v[PULL].buf, v[REACH].buf,
                         v[DECAY].buf, v[SHARE].buf};
    const Py_ssize_t sizes[ARRAYS] = {
        n, n, SIDE_VALUES * k, 2 * (k - 1), 2 * (k - 1), n, n, k, n, k + 1, k, 16 * k, 4 * k, 16 * k, 4 * k, k, k,
        straight ? k : 0, tried.pulls, tried.reaches, tried.decays,
        tried.pulls * (tried.reaches + tried.decays), MODEL_VALUES * k, 2 * (k - 1), 4 * k * k};
    int sound = k >= 2 && k <= MOST_SIDES && tried.pulls <= MOST_PULLS;
    for (int i = 0; i < ARRAYS; i++) sound = sound && count_of(&v[i]) == sizes[i];
    const int64_t *edges = v[EDGE].buf;
    for (Py_ssize_t j = 0; sound && j < k; j++) sound = edges[j] >= 0 && edges[j] < edges[j + 1];
    sound = sound && edges[0] == 0 && edges[k] == n;
    Fitted f;
    if (sound) {
        const Fitted given_fit = {n, k, v[X].buf, v[Z].buf, v[ALONG].buf, v[RESIDUAL].buf,
                                  v[PLACE].buf, v[CORNER].buf, v[SIGMA].buf, v[MIDDLE].buf,
                                  straight ? v[STRAIGHT].buf : NULL, v[MATRIX].buf, v[RHS].buf, v[INVERSE].buf,
                                  v[WEIGHT].buf, edges, v[COUNT].buf, v[KEEP].buf, v[CURVED].buf,
                                  v[CURVE].buf, inflation, {{0}}, NULL, NULL};
        f = given_fit;
        sound = read_sides(v[MODEL].buf, k, f.sides);
    }
    const size_t room = 3 * (size_t)n;
    double *memory = sound ? malloc((room + (size_t)n) * sizeof(double)) : NULL;
    int done = -2;
    if (memory) {
        double *u = memory + room - n;
        f.work = memory;
        f.on = (uint8_t *)(memory + room);
        for (Py_ssize_t i = 0; i < n; i++) u[i] = -f.x[i] / f.z[i];
        done = estimate_corners(&f, &tried, u, v[ESTIMATE].buf, v[COVARIANCE].buf);
    }
    free(memory);
    close_arrays(letters, v);
    if (!sound) return PyErr_Format(PyExc_ValueError, "arrays of corners do not match");
    return done < 0 ? PyErr_NoMemory() : PyBool_FromLong(done);
}

/* ---- what a fit is judged by: groove/search.py, groove/reflections.py; points in order: read.py ---- */

/* Whether edges divide n points into k sides, none of them empty. */
static int are_edges(const Py_buffer *view, Py_ssize_t n)
{
    const int64_t *edges = view->buf;
    const Py_ssize_t k = count_of(view) - 1;
    int sound = k >= 2 && k <= MOST_SIDES && edges[0] == 0 && edges[k] == n;
    for (Py_ssize_t j = 0; sound && j < k; j++) sound = edges[j] < edges[j + 1];
    return sound;
}

/* _costs_of_points_on_sides */
static PyObject *costs_of_points(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char letters[] = "diddD";
    Py_buffer v[5];
    (void)self;
    if (given != 6) return PyErr_Format(PyExc_TypeError, "costs_of_points takes 6 arguments");
    const double tolerance = PyFloat_AsDouble(args[5]);
    if (PyErr_Occurred() || open_arrays(letters, args, v) < 0) return NULL;
    const Py_ssize_t n = count_of(&v[0]), k = count_of(&v[1]) - 1;
    const int sound = are_edges(&v[1], n) && count_of(&v[2]) == k && count_of(&v[3]) == MODEL_VALUES * k
                      && count_of(&v[4]) == n;
    if (sound) {
        const double *residuals = v[0].buf, *sigmas = v[2].buf, *model = v[3].buf;
        const int64_t *edges = v[1].buf;
        double *costs = v[4].buf;
        for (Py_ssize_t j = 0; j < k; j++) {
            const double rough = larger(model[MODEL_VALUES * j + 3], tolerance);
            const double reach = smaller(larger(ROUGH_REACH_SIGMAS * sigmas[j], tolerance), rough);
            const double less = WIDER_TOLERANCE_COST * log(reach / tolerance);
            for (int64_t i = edges[j]; i < edges[j + 1]; i++) {
                const double scaled = residuals[i] / reach;
                costs[i] = smaller(scaled * scaled + less, 1.0);
            }
        }
    }
    close_arrays(letters, v);
    return sound ? Py_NewRef(Py_None) : PyErr_Format(PyExc_ValueError, "arrays of costs do not match");
}

static PyObject *find_gaps(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char letters[] = "ddbiddD";
    Py_buffer v[7];
    (void)self;
    if (given != 7) return PyErr_Format(PyExc_TypeError, "gaps_beside_corners takes 7 arguments");
    if (open_arrays(letters, args, v) < 0) return NULL;
    const Py_ssize_t n = count_of(&v[0]), k = count_of(&v[3]) - 1;
    const int sound = are_edges(&v[3], n) && count_of(&v[1]) == n && count_of(&v[2]) == n
                      && count_of(&v[4]) == 2 * (k - 1) && count_of(&v[5]) == k && count_of(&v[6]) == 2 * (k - 1);
    uint8_t *on = sound ? malloc((size_t)n) : NULL;
    if (on) {
        const Fitted f = {.n = n, .k = k, .along = v[0].buf, .residuals = v[1].buf, .keep = v[2].buf,
                          .edges = v[3].buf, .places = v[4].buf, .sigmas = v[5].buf, .on = on};
        gaps_beside_corners(&f, v[6].buf);
    }
    close_arrays(letters, v);
    if (!sound) return PyErr_Format(PyExc_ValueError, "arrays of a fit do not match");
    if (!on) return PyErr_NoMemory();
    free(on);
    return Py_NewRef(Py_None);
}

typedef struct {
    double u;
    int64_t column;
} Bearing;

static int compare_bearings(const void *a, const void *b)
{
    const Bearing *x = a, *y = b;
    if (x->u != y->u) return x->u < y->u ? -1 : 1;
    return (x->column > y->column) - (x->column < y->column);
}

/* Columns of the valid points in the order of their bearings; how many there are. */
static Py_ssize_t order(const double *x, const double *z, Py_ssize_t n, double *work, int64_t *columns)
{
    Bearing *bearings = (Bearing *)work;
    Py_ssize_t count = 0, rising = 1, falling = 1;
    for (Py_ssize_t i = 0; i < n; i++)
        if (isfinite(x[i]) && isfinite(z[i]) && z[i] > 0) work[count++] = z[i];
    if (!count) return 0;
    double middle = select_rank(work, count, count / 2);
    if (count % 2 == 0) {
        double before = work[0];
        for (Py_ssize_t i = 1; i < count / 2; i++) before = larger(before, work[i]);
        middle = 0.5 * (before + middle);
    }
    const double farthest = FARTHEST_POINT_RATIO * middle, nearest = middle / FARTHEST_POINT_RATIO;
    count = 0;
    for (Py_ssize_t i = 0; i < n; i++) {
        if (!(isfinite(x[i]) && z[i] > nearest && z[i] < farthest && fabs(x[i]) < farthest)) continue;
        const Bearing own = {-x[i] / z[i], i};
        rising &= !count || bearings[count - 1].u <= own.u;
        falling &= !count || bearings[count - 1].u > own.u;
        bearings[count++] = own;
    }
    if (!rising && !falling) qsort(bearings, (size_t)count, sizeof(Bearing), compare_bearings);
    for (Py_ssize_t i = 0; i < count; i++) columns[i] = bearings[falling && !rising ? count - 1 - i : i].column;
    return count;
}

static PyObject *order_points(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char letters[] = "ddDI";
    Py_buffer v[4];
    (void)self;
    if (given != 4) return PyErr_Format(PyExc_TypeError, "order_points takes 4 arguments");
    if (open_arrays(letters, args, v) < 0) return NULL;
    const Py_ssize_t n = count_of(&v[0]);
    const int sound = count_of(&v[1]) == n && count_of(&v[2]) == 2 * n && count_of(&v[3]) == n;
    const Py_ssize_t count = sound ? order(v[0].buf, v[1].buf, n, v[2].buf, v[3].buf) : 0;
    close_arrays(letters, v);
    return sound ? PyLong_FromSsize_t(count) : PyErr_Format(PyExc_ValueError, "arrays of points do not match");
}

/* _scale_costs: groove/steel.py */
static PyObject *scale_costs(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const char letters[] = "ddD";
    Py_buffer v[3];
    (void)self;
    if (given != 4) return PyErr_Format(PyExc_TypeError, "scale_costs takes 4 arguments");
    const double rarely = PyFloat_AsDouble(args[3]);
    if (PyErr_Occurred() || open_arrays(letters, args, v) < 0) return NULL;
    const Py_ssize_t steps = count_of(&v[1]), lines = steps ? count_of(&v[2]) / steps : 0;
    const Py_ssize_t blocks = lines ? count_of(&v[0]) / lines : 0;
    const int sound = lines > 0 && count_of(&v[2]) == steps * lines && count_of(&v[0]) == blocks * lines;
    for (Py_ssize_t k = 0; sound && k < steps; k++)
        for (Py_ssize_t line = 0; line < lines; line++) {
            const double *off = (const double *)v[0].buf + line * blocks, step = ((const double *)v[1].buf)[k];
            double total = 0.0, share = SCALE_COVERED_SHARE;
            int on_before = 0, seen_before = 0, changes = 0;
            for (Py_ssize_t i = 0; i < blocks; i++) {
                const double bare = off[i] * off[i], raised = (off[i] + step) * (off[i] + step);
                const int on = k && raised < bare, seen = smaller(raised, bare) < STRAY_BLOCK_COST;
                total += smaller(on ? raised : bare, STRAY_BLOCK_COST);
                changes += on != on_before && seen && seen_before;
                if (i == 0 && !(on && seen)) share = 1 - share;
                on_before = on;
                seen_before = seen;
            }
            ((double *)v[2].buf)[k * lines + line] = k ? total + rarely * changes - 2 * log(share) : total;
        }
    close_arrays(letters, v);
    return sound ? Py_NewRef(Py_None) : PyErr_Format(PyExc_ValueError, "arrays of scale do not match");
}

static PyMethodDef METHODS[] = {
    {"scale_costs", (PyCFunction)(void (*)(void))scale_costs, METH_FASTCALL, NULL},
    {"order_points", (PyCFunction)(void (*)(void))order_points, METH_FASTCALL, NULL},
    {"costs_of_points", (PyCFunction)(void (*)(void))costs_of_points, METH_FASTCALL, NULL},
    {"gaps_beside_corners", (PyCFunction)(void (*)(void))find_gaps, METH_FASTCALL, NULL},
    {"corner_estimates", (PyCFunction)(void (*)(void))corner_estimates, METH_FASTCALL, NULL},
    {"find_runs", (PyCFunction)(void (*)(void))find_runs, METH_FASTCALL, NULL},
    {"project_points", (PyCFunction)(void (*)(void))project_points, METH_FASTCALL, NULL},
    {"find_pieces", (PyCFunction)(void (*)(void))find_pieces, METH_FASTCALL, NULL},
    {"propose_candidates", (PyCFunction)(void (*)(void))propose_candidates, METH_FASTCALL, NULL},
    {"begin_search", (PyCFunction)(void (*)(void))begin_search, METH_FASTCALL, NULL},
    {"cheapest_chains", (PyCFunction)(void (*)(void))cheapest_chains, METH_FASTCALL, NULL},
    {"refine_fit", (PyCFunction)(void (*)(void))refine_fit, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};

static int add_version(PyObject *module)
{
    return PyModule_AddIntConstant(module, "KERNEL_VERSION", KERNEL_VERSION);
}

static PyModuleDef_Slot SLOTS[] = {{Py_mod_exec, (void *)add_version}, {0, NULL}};

static struct PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "_kernel", NULL, 0, METHODS, SLOTS, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&MODULE); }
