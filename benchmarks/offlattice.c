/* Growth of an off-lattice colony (Li et al. 2024), the algorithm of yeastfit/offlattice in C, to measure that against.

   offlattice REPEATS CELLS DELAY n* p_ps p_sp gamma p_a STATE0 STATE1 STATE2 STATE3

   prints the least time of one growth in seconds, attempts, the sums of x and of y, and the last direction: with the
   same four words of the generator's state, yeastfit's colony to the last bit. Exits with 1 where a choice is empty. */

#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define PI 3.14159265358979323846
#define BIN 4.4
#define BINS_PER_PIXEL (1 / BIN)
#define RETIRED 4

enum { SATED, PSEUDOHYPHAL, CHILDLESS };

typedef struct {
    double x, y;
    int32_t below, direction, mother;
    uint8_t form, count, bears, taken;
} Cell;

static const int BUDDING[2][4] = {{7, -7, 23, 9}, {1, -1, 1, -1}};
static const uint8_t PLACES[2][4] = {{1, 2, 4, 8}, {16, 32, 16, 32}};
static double semi_axes[2][2], displacement[2][2][4][32][2], frame[2][32][4], reach2, cos15, sin15, cos45;

static uint64_t state[4];
static Cell *cells;
static int32_t *bins, *members[3], *places[3], size[3], wrap;

static void tables(void)
{
    const double um[2][2] = {{4.2, 3.0}, {6.7, 1.9}}, pixels = 323.0 / 500.0;
    for (int form = 0; form < 2; form++)
        for (int k = 0; k < 2; k++) semi_axes[form][k] = pixels * um[form][k];
    reach2 = semi_axes[1][0] * semi_axes[1][0];
    cos15 = cos(PI / 12), sin15 = sin(PI / 12), cos45 = cos(PI / 4);
    for (int d = 0; d < 32; d++) {
        double c = cos(PI / 16 * d), s = sin(PI / 16 * d);
        for (int m = 0; m < 2; m++) {
            double a = semi_axes[m][0], b = semi_axes[m][1];
            double f[4] = {c / a, s / a, -s / b, c / b};
            memcpy(frame[m][d], f, sizeof f);
            for (int form = 0; form < 2; form++)
                for (int k = 0; k < 4; k++) {
                    double beta = PI / 16 * BUDDING[form][k], tangent = tan(beta);
                    double phi = beta + atan((a - b) * tangent) / (b + a * (tangent * tangent));
                    double u = a * cos(phi) + semi_axes[form][0] * cos(beta);
                    double v = b * sin(phi) + semi_axes[form][0] * sin(beta);
                    displacement[m][form][k][d][0] = u * c + v * -s;
                    displacement[m][form][k][d][1] = u * s + v * c;
                }
        }
    }
}

static inline uint64_t rotated(uint64_t word, int bits) { return word << bits | word >> (64 - bits); }

static inline double moved_on(uint64_t *words)
{
    uint64_t word = rotated(words[0] + words[3], 23) + words[0], shifted = words[1] << 17;
    words[2] ^= words[0];
    words[3] ^= words[1];
    words[1] ^= words[2];
    words[0] ^= words[3];
    words[2] ^= shifted;
    words[3] = rotated(words[3], 45);
    return (double)(word >> 11) * (1.0 / 9007199254740992.0);
}

static inline double uniform(void) { return moved_on(state); }

static inline int32_t below(int32_t count) { return (int32_t)(count * uniform()); }

static inline void add(int set, int32_t cell)
{
    members[set][size[set]] = cell;
    places[set][cell] = size[set]++;
}

static inline void take(int set, int32_t cell)
{
    int32_t place = places[set][cell], mover = members[set][--size[set]];
    members[set][place] = mover;
    places[set][mover] = place;
}

static inline int32_t one_of(int set)
{
    if (size[set] == 0) exit(1);
    return members[set][below(size[set])];
}

static inline int32_t any_eligible(void)
{
    if (size[SATED] + size[PSEUDOHYPHAL] == 0) exit(1);
    return below(size[SATED] + size[PSEUDOHYPHAL]);
}

static inline int32_t eligible(int32_t rank)
{
    return rank < size[SATED] ? members[SATED][rank] : members[PSEUDOHYPHAL][rank - size[SATED]];
}

static inline void count_on(int32_t index)
{
    Cell *cell = cells + index;
    if (++cell->count == RETIRED) {
        take(cell->form, index);
        if (!cell->bears) take(CHILDLESS, index);
    }
}

static inline void fetch_next(void)
{
    uint64_t words[4];
    memcpy(words, state, sizeof words);
    for (int skipped = 0; skipped < 4; skipped++) moved_on(words);
    __builtin_prefetch(cells + members[PSEUDOHYPHAL][(int32_t)(size[PSEUDOHYPHAL] * moved_on(words))]);
    __builtin_prefetch(cells + members[CHILDLESS][(int32_t)(size[CHILDLESS] * moved_on(words))]);
}

typedef struct { int32_t mother; int form, angle; double x, y; } Attempt;

static inline Attempt next_attempt(int late, int after, const double *rates)
{
    int form = SATED;
    int32_t mother, rank = any_eligible();
    if (!after) {
        mother = eligible(rank);
    } else {
        double u1 = uniform(), u2 = uniform(), u3 = uniform(), p_ps = rates[1], p_sp = rates[2];
        if (late && u3 >= rates[4]) mother = one_of(PSEUDOHYPHAL);
        else if (!late && u3 < rates[4]) mother = one_of(SATED);
        else mother = eligible(rank);
        if (u2 > rates[3] && u1 > p_ps && cells[mother].bears) mother = one_of(CHILDLESS);
        if (cells[mother].form == SATED) form = u1 < p_sp ? PSEUDOHYPHAL : SATED;
        else form = u1 < p_ps && cells[mother].bears ? SATED : PSEUDOHYPHAL;
    }
    int angle = below(4);
    if (late) fetch_next();
    const double *step = displacement[cells[mother].form][form][angle][cells[mother].direction & 31];
    return (Attempt){mother, form, angle, cells[mother].x + step[0], cells[mother].y + step[1]};
}

static inline void cells_around(double x, double y, int32_t *topmost)
{
    static const int near[3] = {0, -1, 1};
    int32_t row = (int32_t)floor(x * BINS_PER_PIXEL), column = (int32_t)floor(y * BINS_PER_PIXEL);
    for (int k = 0; k < 9; k++) {
        topmost[k] = bins[(size_t)((row + near[k / 3]) & wrap) * (wrap + 1) + ((column + near[k % 3]) & wrap)];
        __builtin_prefetch(cells + topmost[k]);
    }
}

static inline int is_free(double x, double y, const int32_t *topmost)
{
    for (int k = 0; k < 9; k++)
        for (int32_t index = topmost[k]; index >= 0; index = cells[index].below) {
            const Cell *cell = cells + index;
            double dx = x - cell->x, dy = y - cell->y;
            const double *f = frame[cell->form][cell->direction & 31];
            double u = fabs(f[0] * dx + f[1] * dy), v = fabs(f[2] * dx + f[3] * dy);
            if ((dx * dx + dy * dy <= reach2) & (u * cos15 + v * sin15 <= cos15) & ((u + v) * cos45 <= cos15)
                & (u * sin15 + v * cos15 <= cos15))
                return 0;
        }
    return 1;
}

static void bear(int32_t index, int32_t mother, int form, double x, double y, int direction)
{
    int32_t row = (int32_t)floor(x * BINS_PER_PIXEL), column = (int32_t)floor(y * BINS_PER_PIXEL);
    int32_t *bin = bins + (size_t)(row & wrap) * (wrap + 1) + (column & wrap);
    cells[index] = (Cell){x, y, *bin, direction, mother, (uint8_t)form, 1, 0, 0};
    *bin = index;
    add(form, index);
    add(CHILDLESS, index);
}

static int64_t grow(int32_t count, int32_t sated, double late, const double *rates)
{
    int64_t attempts = 0;
    memset(size, 0, sizeof size);
    memset(bins, 255, (size_t)(wrap + 1) * (wrap + 1) * sizeof *bins);
    bear(0, -1, SATED, 0.0, 0.0, 0);
    for (int32_t index = 1; index < count; index++) {
        int32_t number = index + 1, mother, around[9];
        int late_now = number >= late, after = number > sated;
        uint64_t here[4];
        Attempt one = next_attempt(late_now, after, rates);
        for (int tried = 1;; tried++) {
            attempts++;
            if (number < sated && tried > 1) count_on(one.mother);
            memcpy(here, state, sizeof here);
            if (cells[one.mother].taken & PLACES[one.form][one.angle]) {
                one = next_attempt(late_now, after, rates);
                continue;
            }
            cells[one.mother].taken |= PLACES[one.form][one.angle];
            cells_around(one.x, one.y, around);
            Attempt following = next_attempt(late_now, after, rates);
            if (is_free(one.x, one.y, around)) break;
            one = following;
        }
        memcpy(state, here, sizeof here);
        mother = one.mother;
        bear(index, mother, one.form, one.x, one.y, cells[mother].direction + BUDDING[one.form][one.angle]);
        if (number >= sated) count_on(mother);
        if (one.form == PSEUDOHYPHAL) {
            if (!cells[mother].bears && cells[mother].count < RETIRED) take(CHILDLESS, mother);
            cells[mother].bears = 1;
        }
    }
    return attempts;
}

int main(int argc, char **argv)
{
    if (argc != 13) return 2;
    int repeats = atoi(argv[1]);
    int32_t count = atoi(argv[2]), side = 4;
    double delay = atof(argv[3]), rates[5], least = INFINITY, sum_x = 0, sum_y = 0;
    int64_t attempts = 0;
    for (int k = 0; k < 5; k++) rates[k] = atof(argv[4 + k]);
    while ((int64_t)side * side < count) side *= 2;
    wrap = side - 1;
    tables();
    for (int k = 0; k < repeats; k++) {
        struct timespec start, end;
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &start);
        cells = aligned_alloc(sizeof *cells, (size_t)count * sizeof *cells);
        bins = malloc((size_t)side * side * sizeof *bins);
        for (int set = 0; set < 3; set++) {
            members[set] = malloc((size_t)count * sizeof(int32_t));
            places[set] = malloc((size_t)count * sizeof(int32_t));
        }
        for (int w = 0; w < 4; w++) state[w] = strtoull(argv[9 + w], NULL, 10);
        attempts = grow(count, (int32_t)round(rates[0] * count), (rates[0] + delay) * count, rates);
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
        double seconds = (double)(end.tv_sec - start.tv_sec) + 1e-9 * (double)(end.tv_nsec - start.tv_nsec);
        if (seconds < least) least = seconds;
        if (k < repeats - 1) {
            free(cells), free(bins);
            for (int set = 0; set < 3; set++) free(members[set]), free(places[set]);
        }
    }
    for (int32_t k = 0; k < count; k++) sum_x += cells[k].x, sum_y += cells[k].y;
    printf("%.9f %lld %.17g %.17g %d\n", least, (long long)attempts, sum_x, sum_y, cells[count - 1].direction);
    return 0;
}
