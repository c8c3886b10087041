/* Least forces, none negative, that bring about what bodies need (Lawson and Hanson, Solving Least Squares Problems,
   ch. 23), by Cholesky factors of the forces that are not zero, which are those of the frame before at first. */

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "kernels.h"

static const double torque_weight = 1e-3, force_weight = 1e-4, limit_weight = 10.0, torque_share = 1.0 - 1e-3;
static const double no_pull = 1e-13; /* Of the largest. */
static const double least = 1e-15;   /* What rounding leaves at least of a column's own part, where two are alike. */
enum { limit_rounds = 6, corrections = 8 };

typedef struct {
    whole columns, rows, joints, width; /* `width` numbers a column: of the rows, then of the joints. */
    double *matrix, *targets, *weights; /* Columns; what they should sum up to; of each number, squared. */
    const double *limits;               /* What joints at their limits should sum up to. */
    char *at_limit;
    whole *passive, count;
    char *is_passive;
    double *products, *factor, *forces, *trial, *pull, *missed; /* The first two (columns, columns), of passive ones. */
} Problem;

static double product(const Problem *p, whole i, whole j)
{
    const double *a = p->matrix + i * p->width, *b = p->matrix + j * p->width;
    double sum = i == j ? force_weight * force_weight : 0.0;
    for (whole k = 0; k < p->width; k++) sum += p->weights[k] * a[k] * b[k];
    return sum;
}

/* Factors the passive products from one row on. */
static void refactor(Problem *p, whole from)
{
    whole n = p->columns;
    for (whole i = from; i < p->count; i++)
        for (whole j = 0; j <= i; j++) {
            double sum = p->products[i * n + j];
            for (whole k = 0; k < j; k++) sum -= p->factor[i * n + k] * p->factor[j * n + k];
            p->factor[i * n + j] = i == j ? sqrt(fmax(sum, least * p->products[i * n + i])) : sum / p->factor[j * n + j];
        }
}

static void enter(Problem *p, whole column)
{
    whole n = p->columns, row = p->count++;
    p->passive[row] = column, p->is_passive[column] = 1;
    for (whole j = 0; j <= row; j++) p->products[row * n + j] = product(p, column, p->passive[j]);
}

/* Takes out the passive forces that are not positive in `trial`, and at zero. */
static void leave(Problem *p)
{
    whole n = p->columns, left = 0, first = p->count;
    for (whole i = p->count; i-- > 0;) {
        whole column = p->passive[i];
        if (p->forces[column] > 0.0 || p->trial[i] > 0.0) continue;
        p->forces[column] = 0.0, p->is_passive[column] = 0, first = i;
    }
    for (whole i = 0; i < p->count; i++) {
        if (!p->is_passive[p->passive[i]]) continue;
        for (whole j = 0, kept = 0; j <= i; j++)
            if (p->is_passive[p->passive[j]]) p->products[left * n + kept++] = p->products[i * n + j];
        left++;
    }
    left = 0;
    for (whole i = 0; i < p->count; i++)
        if (p->is_passive[p->passive[i]]) p->passive[left++] = p->passive[i];
    p->count = left;
    refactor(p, first < left ? first : left);
}

/* Solves for the passive forces, with a right-hand side in `trial`. */
static void solve(Problem *p)
{
    whole n = p->columns, count = p->count;
    for (whole i = 0; i < count; i++) {
        for (whole j = 0; j < i; j++) p->trial[i] -= p->factor[i * n + j] * p->trial[j];
        p->trial[i] /= p->factor[i * n + i];
    }
    for (whole i = count; i-- > 0;) {
        for (whole j = i + 1; j < count; j++) p->trial[i] -= p->factor[j * n + i] * p->trial[j];
        p->trial[i] /= p->factor[i * n + i];
    }
}

static double along(const Problem *p, whole column, const double *vector)
{
    const double *a = p->matrix + column * p->width;
    double sum = 0.0;
    for (whole k = 0; k < p->width; k++) sum += a[k] * vector[k];
    return sum;
}

/* What is missed of the targets, times its weight. */
static void miss(Problem *p)
{
    memcpy(p->missed, p->targets, sizeof(double) * (size_t)p->width);
    for (whole i = 0; i < p->count; i++) {
        const double *a = p->matrix + p->passive[i] * p->width, force = p->forces[p->passive[i]];
        for (whole k = 0; k < p->width; k++) p->missed[k] -= force * a[k];
    }
    for (whole k = 0; k < p->width; k++) p->missed[k] *= p->weights[k];
}

/* Goes to the least squares of the passive forces, those that would be negative taken out. */
static void settle(Problem *p)
{
    while (p->count) {
        for (whole k = 0; k < p->width; k++) p->missed[k] = p->weights[k] * p->targets[k];
        for (whole i = 0; i < p->count; i++) p->trial[i] = along(p, p->passive[i], p->missed);
        solve(p);
        double share = 1.0;
        for (whole i = 0; i < p->count; i++) {
            double now = p->forces[p->passive[i]];
            if (p->trial[i] <= 0.0 && now / (now - p->trial[i] + 1e-300) < share) share = now / (now - p->trial[i] + 1e-300);
        }
        for (whole i = 0; i < p->count; i++) {
            double *now = p->forces + p->passive[i], way = p->trial[i] - *now;
            int first = p->trial[i] <= 0.0 && *now / (*now - p->trial[i] + 1e-300) <= share;
            *now = share == 1.0 ? p->trial[i] : first ? 0.0 : *now + share * way;
        }
        if (share == 1.0) return;
        leave(p);
    }
}

/* Takes out what the factor of products has lost to rounding. */
static void refine(Problem *p)
{
    miss(p);
    for (whole i = 0; i < p->count; i++)
        p->trial[i] = along(p, p->passive[i], p->missed) - force_weight * force_weight * p->forces[p->passive[i]];
    solve(p);
    for (whole i = 0; i < p->count; i++)
        if (p->forces[p->passive[i]] + p->trial[i] > 0.0) p->forces[p->passive[i]] += p->trial[i];
}

static void least_squares(Problem *p, const char *active)
{
    double largest = 0.0;
    settle(p);
    for (whole round = 0; round < 30 * p->columns; round++) {
        miss(p);
        whole best = -1;
        for (whole j = 0; j < p->columns; j++) {
            if (!active[j]) continue;
            double pull = p->pull[j] = along(p, j, p->missed);
            if (fabs(pull) > largest && round == 0) largest = fabs(pull);
            if (!p->is_passive[j] && pull > no_pull * (1.0 + largest) && (best < 0 || pull > p->pull[best])) best = j;
        }
        if (best < 0) return;
        enter(p, best);
        refactor(p, p->count - 1);
        settle(p);
        if (!p->is_passive[best]) return; /* Rounding alone pulled it. */
    }
}

/* Targets gave way a little to effort: these forces give it back, as long as none becomes negative. */
static void correct(Problem *p)
{
    for (int round = 0; round < corrections && p->count; round++) {
        miss(p);
        for (whole k = 0; k < p->width; k++) {
            whole joint = k - p->rows;
            if (joint < 0) continue;
            double sum = 0.0;
            for (whole i = 0; i < p->count; i++) sum += p->forces[p->passive[i]] * p->matrix[p->passive[i] * p->width + k];
            p->missed[k] = p->at_limit[joint] ? limit_weight * limit_weight * (p->limits[joint] - sum) : 0.0;
        }
        for (whole i = 0; i < p->count; i++) p->trial[i] = along(p, p->passive[i], p->missed);
        solve(p);
        double change = 0.0;
        for (whole i = 0; i < p->count; i++) {
            if (p->forces[p->passive[i]] + p->trial[i] <= 0.0) return;
            change = fmax(change, fabs(p->trial[i]));
        }
        for (whole i = 0; i < p->count; i++) p->forces[p->passive[i]] += p->trial[i];
        if (change < 1e-14) return;
    }
}

/* Weighs joints, those at their limits more; the passive products follow. */
static void weigh(Problem *p, const double *free)
{
    for (whole i = 0; i < p->joints; i++) {
        double weak = torque_weight * torque_weight, strong = p->at_limit[i] ? limit_weight * limit_weight : 0.0;
        p->weights[p->rows + i] = weak + strong;
        p->targets[p->rows + i] = (weak * free[i] + strong * p->limits[i]) / (weak + strong);
    }
    for (whole i = 0; i < p->count; i++)
        for (whole j = 0; j <= i; j++) p->products[i * p->columns + j] = product(p, p->passive[i], p->passive[j]);
    refactor(p, 0);
}

/* Finds the joints whose torques are over their limits; returns whether they are others than before. */
static int find_limits(Problem *p, const double *free, double *limits)
{
    int changed = 0;
    for (whole i = 0; i < p->joints; i++) {
        double share = free[i];
        for (whole k = 0; k < p->count; k++)
            share -= p->forces[p->passive[k]] * p->matrix[p->passive[k] * p->width + p->rows + i];
        char over = fabs(share) > torque_share;
        changed |= over != p->at_limit[i];
        p->at_limit[i] = over;
        limits[i] = free[i] - (share > 0.0 ? 1.0 : -1.0);
    }
    return changed;
}

/* Forces (2, F, N), with limits on torques and without, of F frames: those nearest to `effects` (F, N, H) times forces =
   `targets` (F, H), with `free` (F, n) less `efforts` (F, N, n) times forces between -1 and 1; of all such, those of least
   effort. Where they are not `active` they are zero. Returns 0, or 1 where memory is short. */
EXPORTED int least_forces(const double *effects, const double *targets, const double *efforts, const double *free_torques,
                          const char *active, whole frames, whole columns, whole rows, whole joints, double *found)
{
    whole width = rows + joints;
    size_t n = (size_t)columns, w = (size_t)width, numbers = n * w + 2 * n * n + 3 * n + 3 * w + (size_t)joints + 1;
    double *space = calloc(numbers, sizeof(double));
    whole *passive = malloc(sizeof(whole) * (n + 1));
    char *flags = malloc(n + (size_t)joints + 1);
    int failed = !space || !passive || !flags;
    if (!failed) {
        double *limits = space + numbers - (size_t)joints - 1, *at = space;
        Problem p = {.columns = columns, .rows = rows, .joints = joints, .width = width, .limits = limits};
        p.passive = passive, p.is_passive = flags, p.at_limit = flags + n;
        p.matrix = at, at += n * w, p.products = at, at += n * n, p.factor = at, at += n * n;
        p.forces = at, at += n, p.trial = at, at += n, p.pull = at, at += n;
        p.targets = at, at += w, p.weights = at, at += w, p.missed = at;
        memset(flags, 0, n + (size_t)joints + 1);
        for (whole k = 0; k < rows; k++) p.weights[k] = 1.0;
        for (whole f = 0; f < frames; f++) {
            const char *here = active + f * columns;
            const double *own = free_torques + f * joints;
            whole before = p.count;
            p.count = 0;
            memset(p.forces, 0, sizeof(double) * n), memset(p.is_passive, 0, n), memset(p.at_limit, 0, (size_t)joints);
            memcpy(p.targets, targets + f * rows, sizeof(double) * (size_t)rows);
            for (whole j = 0; j < columns; j++) {
                memcpy(p.matrix + j * width, effects + (f * columns + j) * rows, sizeof(double) * (size_t)rows);
                memcpy(p.matrix + j * width + rows, efforts + (f * columns + j) * joints, sizeof(double) * (size_t)joints);
            }
            for (whole i = 0; i < before; i++)
                if (here[passive[i]]) p.passive[p.count++] = passive[i], p.is_passive[passive[i]] = 1;
            weigh(&p, own);
            least_squares(&p, here), refine(&p), correct(&p);
            memcpy(found + (frames + f) * columns, p.forces, sizeof(double) * n);
            for (int round = 0; round < limit_rounds && find_limits(&p, own, limits); round++) {
                weigh(&p, own);
                least_squares(&p, here), refine(&p), correct(&p);
            }
            memcpy(found + f * columns, p.forces, sizeof(double) * n);
        }
    }
    free(space), free(passive), free(flags);
    return failed;
}
