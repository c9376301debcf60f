/* Loops over a profile's points, compiled: what groove/refinement.py does with NumPy.

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
    for (int round = 0; round < 12; round++) {
        const double q = curve_height(a, s), sb = along + s * cosine - q * sine;
        dq = curve_slope(a, s);
        const double qb = curve_height(b, sb);
        dqb = curve_slope(b, sb);
        const double slope = sine + dq * cosine - dqb * (cosine - dq * sine);
        if (fabs(slope) < _PARALLEL_SINE) return 0;
        const double step = (away + s * sine + q * cosine - qb) / slope;
        s -= step;
        if (fabs(step) < _SETTLED_NEWTON_STEP) break;
    }
    if (!(fabs(s) < _FARTHEST_CORNER_DISTANCE) || fabs(dq) > STEEPEST_SLOPE || fabs(dqb) > STEEPEST_SLOPE)
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

typedef struct {
    double lags[LONGEST_LAG], inflation;
} Correlation;

static double noise_share_in_fit(double parameters, double inflation, double count)
{
    return smaller(parameters * larger(inflation, 1.0) / count, LARGEST_NOISE_SHARE_IN_FIT);
}

static double lag_of_half_correlation(const double *rho)
{
    int k = 1;
    while (k < LONGEST_LAG && !(rho[k] < 0.5)) k++;
    if (k == LONGEST_LAG) return WIDEST_HALF_LAG;
    const double before = k > 1 ? -log(smaller(rho[k - 1], 1.0)) : 0.0;
    const double share = (log(2.0) - before) / (-log(larger(rho[k], _LEAST_CORRELATION)) - before);
    if (k == 1) return larger(share, _SHORTEST_LAG);
    return smaller(sqrt((k - 1) * (k - 1) + share * (2 * k - 1)), WIDEST_HALF_LAG);
}

static void smooth_correlation(const double *rho, double count, double *lags)
{
    const double half = lag_of_half_correlation(rho);
    int compared = (int)(2.5 * half);
    compared = compared < 3 ? 3 : compared;
    compared = compared > LONGEST_LAG - 1 ? LONGEST_LAG - 1 : compared;
    double shapes[2][LONGEST_LAG], error[2] = {0.0, 0.0}, weight[2];
    for (int p = 0; p < 2; p++)
        for (int k = 0; k < LONGEST_LAG; k++) {
            const double lag = k / half;
            shapes[p][k] = pow(0.5, p ? lag * lag : lag);
            const double off = shapes[p][k] - rho[k];
            if (k >= 1 && k <= compared) error[p] += off * off;
        }
    const double variance = 2 * half / count * compared / 3, least = smaller(error[0], error[1]);
    for (int p = 0; p < 2; p++) weight[p] = exp(-0.5 * (error[p] - least) / variance);
    for (int k = 0; k < LONGEST_LAG; k++)
        lags[k] = (weight[0] * shapes[0][k] + weight[1] * shapes[1][k]) / (weight[0] + weight[1]);
}

/* `grid` holds scaled residuals by column, zero where there is none, and `held` says where. */
static void estimate_correlation(
    const double *grid, const double *held, Py_ssize_t columns, double count, double parameters,
    Correlation *found)
{
    double rho[LONGEST_LAG], put_back[LONGEST_LAG], lost = 0.0, total = 0.0;
    for (int k = 0; k < LONGEST_LAG; k++) {
        double product = 0.0, pairs = 0.0;
        for (Py_ssize_t i = 0; i + k < columns; i++) {
            product += grid[i + k] * grid[i];
            pairs += held[i + k] * held[i];
        }
        rho[k] = product / larger(pairs, 1.0);
    }
    const double scale = larger(rho[0], 1e-30);
    for (int k = 0; k < LONGEST_LAG; k++) rho[k] /= scale;
    for (int round = 0; round < 3; round++) {
        for (int k = 0; k < LONGEST_LAG; k++) put_back[k] = rho[k] * (1 - lost) + lost;
        smooth_correlation(put_back, count, found->lags);
        total = 0.0;
        for (int k = 0; k < LONGEST_LAG; k++) total += found->lags[k];
        lost = noise_share_in_fit(parameters, larger(2 * total - 1, 1.0), count);
    }
    found->inflation = larger(1.0, 2 * total - 1);
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
    double *u, *along, *residuals, *scaled, *work, *grid, *held;
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

static void drop_points_beside_ghosts(const Row *row)
{
    const Py_ssize_t n = row->n;
    Py_ssize_t dropped = 0;
    for (Py_ssize_t i = 0; i < n; i++) dropped += !row->keep[i];
    if (dropped < FEWEST_POINTS_OF_GHOST) return;
    for (Py_ssize_t a = 0, b; a < n; a = b) {
        const int side = (row->scaled[a] > GHOST_SIGMAS) - (row->scaled[a] < -GHOST_SIGMAS);
        Py_ssize_t outliers = 0;
        for (b = a; b < n; b++) {
            if ((row->scaled[b] > GHOST_SIGMAS) - (row->scaled[b] < -GHOST_SIGMAS) != side) break;
            outliers += !row->keep[b];
        }
        if (a == 0 && b == n) return;
        if (outliers >= FEWEST_POINTS_OF_GHOST) memset(row->keep + a, 0, (size_t)(b - a));
    }
}

/* _fit_sides_once: from the curves and corners in `fit`, into it; 0 if there is no fit. */
static int fit_sides_once(
    const Row *row, Fit *fit, const double *limits, double weight[][4], const Side *sides, int shadows)
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
    }
    if (shadows) drop_points_beside_ghosts(row);
    if (row->is_left_out)
        for (Py_ssize_t i = 0; i < row->n; i++) row->keep[i] &= !row->left_out[i];

    double total = 0.0, pooled = 0.0, sums[MOST_SIDES][11];
    for (int j = 0; j < k; j++) {
        double *sum = sums[j];
        memset(sum, 0, sizeof sums[j]);
        for (Py_ssize_t i = fit->edges[j]; i < fit->edges[j + 1]; i++) {
            if (!row->keep[i]) continue;
            const double u = row->along[i] / SCALING_LENGTH, d = row->residuals[i];
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
            const double u = row->along[i] / SCALING_LENGTH;
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

static void estimate_noise(const Row *row, const Fit *fit, Correlation *noise)
{
    double count = 0.0, parameters = 0.0;
    memset(row->grid, 0, (size_t)row->column_count * sizeof(double));
    memset(row->held, 0, (size_t)row->column_count * sizeof(double));
    for (int j = 0; j < fit->k; j++) {
        const double sigma = larger(fit->sigmas[j], 1e-9);
        for (Py_ssize_t i = fit->edges[j]; i < fit->edges[j + 1]; i++)
            if (row->keep[i]) {
                row->grid[row->columns[i]] = row->residuals[i] / sigma;
                row->held[row->columns[i]] = 1.0;
                count += 1.0;
            }
        parameters += 2 + fit->curved[j];
    }
    estimate_correlation(row->grid, row->held, row->column_count, count, parameters, noise);
}

/* What correlated_normal_matrices gives for one row of a basis, on one side. */
static double correlated_square(
    const Row *row, const Correlation *noise, const double *share, Py_ssize_t start, Py_ssize_t end)
{
    double sum = 0.0;
    int64_t first = INT64_MAX, last = INT64_MIN;
    for (Py_ssize_t i = start; i < end; i++)
        if (row->keep[i]) {
            first = row->columns[i] < first ? row->columns[i] : first;
            last = row->columns[i] > last ? row->columns[i] : last;
        }
    const Py_ssize_t room = (Py_ssize_t)(last - first + 1);
    memset(row->grid, 0, (size_t)room * sizeof(double));
    for (Py_ssize_t i = start; i < end; i++)
        if (row->keep[i]) row->grid[row->columns[i] - first] = share[i];
    for (int lag = 0; lag < LONGEST_LAG && lag < room; lag++) {
        double product = 0.0;
        for (Py_ssize_t i = 0; i + lag < room; i++) product += row->grid[i] * row->grid[i + lag];
        sum += (lag ? 2.0 : 1.0) * noise->lags[lag] * product;
    }
    return sum;
}

static void log_odds_of_straight_sides(
    const Row *row, Fit *fit, const Correlation *noise, const Side *sides)
{
    for (int j = 0; j < fit->k; j++) {
        if (sides[j].bend_is_expected) {
            fit->straight[j] = -INFINITY;
            continue;
        }
        const double *c = fit->inverse[j] + 8; /* symmetric: row and column of the bend */
        for (Py_ssize_t i = fit->edges[j]; i < fit->edges[j + 1]; i++) {
            const double u = row->along[i] / SCALING_LENGTH;
            row->work[i] = c[0] + u * (c[1] + u * (c[2] + u * c[3]));
        }
        const double lost = noise_share_in_fit(2 + fit->curved[j], noise->inflation, fit->counts[j]);
        double variance = fit->sigmas[j] * fit->sigmas[j] / (1 - lost);
        variance *= correlated_square(row, noise, row->work, fit->edges[j], fit->edges[j + 1]);
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
            width += 1;
        }
    }
    return 1;
}

/* 1 if a fit was found, 2 if it is near a known one, 0 if there is none. */
static int refine(
    Row *row, Fit *fit, const Side *sides, double tolerance, int annealed, const double *known,
    Py_ssize_t known_count, Correlation *noise)
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
        estimate_noise(row, fit, noise);
        noise_is_known = 1;
        inflation = noise->inflation;
        log_odds_of_straight_sides(row, fit, noise, sides);
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
#define FIT_VALUES(k) ((k) * (8 + 2 + 2 + 1 + 1 + 1 + 1 + 1 + 16 + 4 + 16 + 4) - 4 + LONGEST_LAG + 1)

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
    const double *model = v[5].buf;
    for (int j = 0; sound && j < k; j++) sound = !model[MODEL_VALUES * j + 4] || (j > 0 && j < k - 1);
    double *memory = sound ? calloc((size_t)(3 * n + 2 * column_count + n / 8 + 2), sizeof(double)) : NULL;
    if (!memory) {
        if (sound) PyErr_NoMemory();
        else PyErr_SetString(PyExc_ValueError, "arrays of a fit do not match");
        close_arrays(kinds, v);
        return NULL;
    }
    Row row = {n, v[0].buf, v[1].buf, columns, column_count, memory, v[8].buf, (double *)v[8].buf + n,
               memory + n, memory + 2 * n, memory + 3 * n, memory + 3 * n + column_count, v[9].buf,
               (uint8_t *)(memory + 3 * n + 2 * column_count), 0};
    for (Py_ssize_t i = 0; i < n; i++) row.u[i] = -row.x[i] / row.z[i];
    Side sides[MOST_SIDES];
    Fit fit;
    Correlation noise;
    memset(&fit, 0, sizeof fit);
    memset(&noise, 0, sizeof noise);
    fit.k = (int)k;
    memcpy(fit.curves, v[3].buf, (size_t)k * sizeof(Curve));
    memcpy(fit.corners, v[4].buf, (size_t)(k - 1) * 2 * sizeof(double));
    for (int j = 0; j < k; j++) {
        const double *m = model + MODEL_VALUES * j;
        const Side side = {m[0], m[1], m[2], m[3], m[4] != 0, m[5] != 0};
        sides[j] = side;
    }
    const Py_ssize_t known = count_of(&v[6]) / (2 * (k - 1));
    const int found = refine(&row, &fit, sides, tolerance, annealed, v[6].buf, known, &noise);
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
        to = put(to, noise.lags, LONGEST_LAG);
        *to = noise.inflation;
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

static PyMethodDef METHODS[] = {
    {"refine_fit", (PyCFunction)(void (*)(void))refine_fit, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "_kernel", NULL, 0, METHODS};

PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&MODULE); }
