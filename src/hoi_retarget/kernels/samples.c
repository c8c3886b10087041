/* Samples of a surface that are near a link, or in its solid, and skin of a link that is near a surface. */

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "kernels.h"

/* A walk over the samples within a radius of a link's middle, cell by cell. */
typedef struct {
    const Samples *samples;
    const double *rotation, *origin, *centre; /* Of the link in the surface's frame; its middle there. */
    double radius;
    whole low[3], high[3], i, j, at, stop;
    const double *sample;
    double seen[3]; /* The sample in the link's frame. */
} Walk;

static Walk walk(const Samples *samples, const double *rotation, const double *origin, const double *centre, double radius)
{
    Walk walk = {.samples = samples, .rotation = rotation, .origin = origin, .centre = centre, .radius = radius};
    int any = samples->total > 0;
    for (int axis = 0; axis < 3; axis++) {
        double from = (centre[axis] - radius - samples->origin[axis]) / samples->edge;
        double to = (centre[axis] + radius - samples->origin[axis]) / samples->edge;
        whole last = samples->counts[axis] - 1;
        any &= to >= 0.0 && from < (double)(last + 1);
        walk.low[axis] = from > 0.0 && any ? (whole)from : 0;
        walk.high[axis] = to < (double)last && any ? (whole)to : last;
    }
    walk.i = any ? walk.low[0] : walk.high[0] + 1;
    walk.j = walk.low[1] - 1;
    return walk;
}

static int next(Walk *walk)
{
    const Samples *samples = walk->samples;
    for (;;) {
        for (; walk->at < walk->stop; walk->at++) {
            const double *p = samples->points + 3 * walk->at, *r = walk->rotation;
            double a = p[0] - walk->centre[0], b = p[1] - walk->centre[1], c = p[2] - walk->centre[2];
            if (a * a + b * b + c * c > walk->radius * walk->radius) continue;
            double x = p[0] - walk->origin[0], y = p[1] - walk->origin[1], z = p[2] - walk->origin[2];
            for (int i = 0; i < 3; i++) walk->seen[i] = x * r[i] + y * r[3 + i] + z * r[6 + i];
            walk->sample = p;
            walk->at++;
            return 1;
        }
        if (walk->i > walk->high[0]) return 0;
        if (++walk->j > walk->high[1]) {
            walk->j = walk->low[1] - 1;
            walk->i++;
            continue;
        }
        whole row = (walk->i * samples->counts[1] + walk->j) * samples->counts[2];
        walk->at = samples->starts[row + walk->low[2]];
        walk->stop = samples->starts[row + walk->high[2] + 1];
    }
}

/* How far a point is from a solid's grid, at least. */
static double way_to_grid(const Grid *grid, const double *point)
{
    double most = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        double before = grid->origin[axis] - point[axis];
        double after = point[axis] - grid->origin[axis] - grid->step * (double)(grid->shape[axis] - 1);
        if (before > most) most = before;
        if (after > most) most = after;
    }
    return most;
}

/* Distance at the nearest node, and the way to the grid. */
static double node_distance(const Grid *grid, const double *point)
{
    whole node = 0;
    double off = 0.0;
    int outside = 0;
    for (int axis = 0; axis < 3; axis++) {
        double last = (double)(grid->shape[axis] - 1), at = rint((point[axis] - grid->origin[axis]) / grid->step);
        outside |= point[axis] < grid->origin[axis] || point[axis] > grid->origin[axis] + grid->step * last;
        at = at > 0.0 ? (at < last ? at : last) : 0.0;
        node = node * grid->shape[axis] + (whole)at;
        double way = point[axis] - (grid->origin[axis] + grid->step * at);
        off += way * way;
    }
    return (double)grid->values[node] + (outside ? sqrt(off) : 0.0);
}

typedef struct {
    double distance;
    const double *place;
    whole index;
} Candidate;

/* Up to `most` samples of each of N poses that are nearest to a solid and nearer than `range`, no two of them nearer to
   each other than `apart`; returns 0, or 1 where memory is short. */
EXPORTED int nearest_samples(const Samples *samples, const Grid *solid, const double *rotations, const double *origins,
                             const double *centres, whole poses, double radius, double range, whole most, double apart,
                             whole *chosen, whole *number)
{
    Candidate *found = malloc(sizeof(Candidate) * (size_t)(samples->total ? samples->total : 1));
    if (!found) return 1;
    for (whole n = 0; n < poses; n++) {
        Walk around = walk(samples, rotations + 9 * n, origins + 3 * n, centres + 3 * n, radius + range);
        whole count = 0;
        while (next(&around)) {
            if (way_to_grid(solid, around.seen) >= range) continue;
            double distance = node_distance(solid, around.seen);
            if (distance < range) found[count++] = (Candidate){distance, around.sample, samples->indices[around.at - 1]};
        }
        for (number[n] = 0; number[n] < most && count;) {
            Candidate first = found[0];
            for (whole k = 1; k < count; k++)
                if (found[k].distance < first.distance ||
                    (found[k].distance == first.distance && found[k].index < first.index))
                    first = found[k];
            chosen[n * most + number[n]++] = first.index;
            whole left = 0;
            for (whole k = 0; k < count; k++) {
                double a = found[k].place[0] - first.place[0], b = found[k].place[1] - first.place[1],
                       c = found[k].place[2] - first.place[2];
                if (a * a + b * b + c * c >= apart * apart) found[left++] = found[k];
            }
            count = left;
        }
    }
    free(found);
    return 0;
}

/* Distance from a solid of the deepest of the samples in a ball, for each of N poses. */
EXPORTED void deepest_samples(const Samples *samples, const Grid *solid, const double *rotations, const double *origins,
                              const double *centres, whole poses, double radius, double *least)
{
    for (whole n = 0; n < poses; n++) {
        Walk around = walk(samples, rotations + 9 * n, origins + 3 * n, centres + 3 * n, radius);
        least[n] = INFINITY;
        while (next(&around)) {
            double way = way_to_grid(solid, around.seen);
            if (way > 0.0 && way >= least[n]) continue;
            double distance = grid_distance(solid, around.seen, NULL);
            if (distance < least[n]) least[n] = distance;
        }
    }
}

/* Adds J^T J (N, 6, 6) and J^T d (N, 6) of the distances d of all samples inside a solid, for each of N poses; J is by
   the link's shift and its turn about a pivot, in the surface's axes. */
EXPORTED void inside_sums(const Samples *samples, const Grid *solid, const double *rotations, const double *origins,
                          const double *centres, const double *pivots, whole poses, double radius, double *squares,
                          double *products)
{
    for (whole n = 0; n < poses; n++) {
        Walk around = walk(samples, rotations + 9 * n, origins + 3 * n, centres + 3 * n, radius);
        while (next(&around)) {
            if (way_to_grid(solid, around.seen) > 0.0) continue;
            double slope[3], by[6];
            double distance = grid_distance(solid, around.seen, slope);
            if (distance >= 0.0) continue;
            const double *r = around.rotation, *p = around.sample, *pivot = pivots + 3 * n;
            for (int i = 0; i < 3; i++) by[i] = -(r[3 * i] * slope[0] + r[3 * i + 1] * slope[1] + r[3 * i + 2] * slope[2]);
            double u = p[0] - pivot[0], v = p[1] - pivot[1], w = p[2] - pivot[2];
            by[3] = v * by[2] - w * by[1], by[4] = w * by[0] - u * by[2], by[5] = u * by[1] - v * by[0];
            for (int i = 0; i < 6; i++) {
                products[6 * n + i] += by[i] * distance;
                for (int j = 0; j < 6; j++) squares[36 * n + 6 * i + j] += by[i] * by[j];
            }
        }
    }
}

static double placed_distance(const Field *surface, const double *rotation, const double *origin, const double *point)
{
    double place[3];
    for (int i = 0; i < 3; i++)
        place[i] = rotation[3 * i] * point[0] + rotation[3 * i + 1] * point[1] + rotation[3 * i + 2] * point[2] + origin[i];
    return field_distance(surface, place, NULL);
}

static int close_to_any(const double *points, const whole *chosen, whole count, whole point, double apart)
{
    const double *p = points + 3 * point;
    for (whole k = 0; k < count; k++) {
        const double *q = points + 3 * chosen[k];
        double x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
        if (x * x + y * y + z * z < apart * apart) return 1;
    }
    return 0;
}

/* For each of N poses of a link on a surface: `each` points (P, 3) of its skin that are near, the nearest one, then the
   nearest that is not closer than `apart` to those before, and so on; the distance of the nearest, and one that no point
   is nearer than. Skin comes in patches around its first points: patch c has `counts[c]` points, `order[firsts[c]]` and
   following, within `radii[c]`. Those further than `near`, or `spread` further than the nearest, are not looked at: they
   are chosen, in their order, when none of the others is left. Returns 0, or 1 where memory is short. */
EXPORTED int nearest_skin(const Field *surface, const double *points, whole total, const whole *order,
                          const whole *firsts, const whole *counts, const double *radii, whole patches,
                          const double *rotations, const double *origins, whole poses, double near, double spread,
                          whole each, double apart, whole *chosen, double *nearest, double *least)
{
    double *rough = malloc(sizeof(double) * (size_t)patches);
    Candidate *found = malloc(sizeof(Candidate) * (size_t)total);
    char *seen = malloc((size_t)total);
    int failed = !rough || !found || !seen;
    for (whole n = 0; n < poses && !failed; n++) {
        const double *r = rotations + 9 * n, *o = origins + 3 * n;
        double smallest = INFINITY;
        least[n] = nearest[n] = INFINITY;
        for (whole c = 0; c < patches; c++) {
            rough[c] = placed_distance(surface, r, o, points + 3 * c);
            if (rough[c] < smallest) smallest = rough[c];
            if (rough[c] - radii[c] < least[n]) least[n] = rough[c] - radii[c];
        }
        whole count = 0, *own = chosen + n * each, next_one = 0;
        memset(seen, 0, (size_t)total);
        double limit = smallest + spread < near ? smallest + spread : near;
        for (whole c = 0; c < patches; c++) {
            if (!(rough[c] - radii[c] < limit)) continue;
            for (whole k = firsts[c]; k < firsts[c] + counts[c]; k++) {
                const double *place = points + 3 * order[k];
                found[count++] = (Candidate){placed_distance(surface, r, o, place), place, order[k]};
                seen[order[k]] = 1;
            }
        }
        for (whole e = 0; e < each; e++) {
            if (count) {
                Candidate first = found[0];
                for (whole k = 1; k < count; k++)
                    if (found[k].distance < first.distance ||
                        (found[k].distance == first.distance && found[k].index < first.index))
                        first = found[k];
                own[e] = first.index;
                if (e == 0) nearest[n] = first.distance;
                whole left = 0;
                for (whole k = 0; k < count; k++)
                    if (!close_to_any(points, own + e, 1, found[k].index, apart)) found[left++] = found[k];
                count = left;
                continue;
            }
            while (next_one < total && (seen[next_one] || close_to_any(points, own, e, next_one, apart))) next_one++;
            own[e] = next_one < total ? next_one : own[0];
        }
    }
    free(rough), free(found), free(seen);
    return failed;
}

/* For each of N poses, the way of a solid along a direction until no sample is inside it, up to `most`, in steps of at
   least `least_step`; and the sample nearest to it before, in its frame (N, 3), its middle where there is none. Samples
   within `radius` are seen. A solid may overrate distances beyond its grid by a factor of `overrated`. Returns 0, or 1
   where memory is short. */
EXPORTED int ways_out(const Samples *samples, const Grid *solid, const double *rotations, const double *origins,
                      const double *centres, const double *middle, whole poses, double radius, const double *directions,
                      double most, double least_step, double overrated, double *ways, double *nearest)
{
    double *seen = malloc(sizeof(double) * 4 * (size_t)(samples->total ? samples->total : 1));
    if (!seen) return 1;
    for (whole n = 0; n < poses; n++) {
        const double *r = rotations + 9 * n, *along = directions + 3 * n;
        Walk around = walk(samples, r, origins + 3 * n, centres + 3 * n, radius);
        double back[3], least = INFINITY;
        whole count = 0;
        for (int i = 0; i < 3; i++) {
            back[i] = r[i] * along[0] + r[3 + i] * along[1] + r[6 + i] * along[2];
            nearest[3 * n + i] = middle[i];
        }
        while (next(&around)) {
            if (way_to_grid(solid, around.seen) > (least > most ? least : most)) continue;
            double distance = grid_distance(solid, around.seen, NULL);
            if (distance < least) {
                least = distance;
                for (int i = 0; i < 3; i++) nearest[3 * n + i] = around.seen[i];
            }
            if (distance >= most) continue;
            for (int i = 0; i < 3; i++) seen[4 * count + i] = around.seen[i];
            seen[4 * count++ + 3] = distance;
        }
        for (ways[n] = 0.0; ways[n] < most;) {
            double depth = 0.0;
            for (whole k = 0; k < count; k++) {
                if (seen[4 * k + 3] > overrated * ways[n]) continue;
                double place[3];
                for (int i = 0; i < 3; i++) place[i] = seen[4 * k + i] - ways[n] * back[i];
                double distance = grid_distance(solid, place, NULL);
                if (-distance > depth) depth = -distance;
            }
            if (depth <= 0.0) break;
            ways[n] += depth > least_step ? depth : least_step;
        }
        if (ways[n] > most) ways[n] = most;
    }
    free(seen);
    return 0;
}
