/* Points in nested balls that can be the nearest ones to a solid or a surface. */

#include <math.h>
#include <stddef.h>
#include "kernels.h"

/* A distance is that of the samples, less or more than an error and a share of it (`Accuracy`). */
typedef struct {
    double error, outside, inside, beyond, from;
} Accuracy;

typedef struct {
    const Grid *solid;
    const Field *surface; /* One of the two. */
    double factor;        /* Of its size over that of the places. */
    const Accuracy *accuracy;
    const double *rotation, *translation;
} Asked;

static void bounds(const Asked *asked, const double *point, double *lower, double *upper)
{
    double place[3];
    for (int i = 0; i < 3; i++) {
        const double *row = asked->rotation + 3 * i;
        place[i] = (row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + asked->translation[i]) * asked->factor;
    }
    double found = asked->solid ? grid_distance(asked->solid, place, NULL) : field_distance(asked->surface, place, NULL);
    found /= asked->factor;
    const Accuracy *accuracy = asked->accuracy;
    double share = found < 0.0 ? accuracy->inside : accuracy->outside, size = fabs(found);
    *lower = found - accuracy->error - share * size;
    *upper = found + accuracy->error + (found > accuracy->from ? accuracy->beyond : share) * size;
}

/* Points of a tree that can be the nearest ones at each of N places, within its limit: place, point, bounds. `centres` and
   `radii` are those of the balls, level by level, the largest first; each has up to `branches` balls of the next level,
   those of the last one points. `balls` is room for twice as many numbers as there are points, `low` for as many. Returns
   how many are found, of which those up to `room` are written. */
EXPORTED whole near_points(const Grid *solid, const Field *surface, double factor, const Accuracy *accuracy,
                           const double *centres, const double *radii, const whole *counts, whole levels,
                           const double *points, whole total, whole branches, const double *rotations,
                           const double *translations, const double *limits, whole places, whole *balls, double *low,
                           whole room, whole *place, whole *point, double *lower, double *upper)
{
    whole found = 0;
    for (whole n = 0; n < places; n++) {
        Asked asked = {solid, surface, factor, accuracy, rotations + 9 * n, translations + 3 * n};
        double most = limits[n], high;
        whole *now = balls, *next = balls + total, count = counts[0], first = 0;
        for (whole k = 0; k < count; k++) now[k] = k;
        for (whole level = 0; level < levels; level++) {
            const double *radius = radii + first, *centre = centres + 3 * first;
            whole below = level + 1 < levels ? counts[level + 1] : total, kept = 0;
            for (whole k = 0; k < count; k++) {
                bounds(&asked, centre + 3 * now[k], low + k, &high);
                if (high + radius[now[k]] < most) most = high + radius[now[k]];
            }
            for (whole k = 0; k < count; k++) {
                if (low[k] - radius[now[k]] > most) continue;
                for (whole ball = now[k] * branches; ball < (now[k] + 1) * branches && ball < below; ball++)
                    next[kept++] = ball;
            }
            whole *before = now;
            first += counts[level], now = next, next = before, count = kept;
        }
        whole start = found;
        for (whole k = 0; k < count; k++) {
            double least;
            bounds(&asked, points + 3 * now[k], &least, &high);
            if (high < most) most = high;
            if (least > most) continue;
            if (found < room) place[found] = n, point[found] = now[k], lower[found] = least, upper[found] = high;
            found++;
        }
        if (found > room) continue;
        whole left = start; /* The limit fell on the way. */
        for (whole k = start; k < found; k++) {
            if (lower[k] > most) continue;
            place[left] = n, point[left] = point[k], lower[left] = lower[k], upper[left++] = upper[k];
        }
        found = left;
    }
    return found;
}
