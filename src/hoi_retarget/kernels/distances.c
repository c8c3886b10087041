/* Distances from sampled solids and surfaces, trilinear between their samples.

   Differences of samples are single, as the samples are; all else is double. */

#include <math.h>
#include <stdint.h>
#include "kernels.h"

static const double last_place = 1.0 - 1e-12;

/* Value between the eight corners of a cell, z running fastest, and its derivatives by the place. */
static double between(const float *corner, double x, double y, double z, double *slope)
{
    float by_z[4];
    double along_z[4];
    for (int k = 0; k < 4; k++) {
        by_z[k] = corner[2 * k + 1] - corner[2 * k];
        along_z[k] = corner[2 * k] + z * by_z[k];
    }
    double by_y[2] = {along_z[1] - along_z[0], along_z[3] - along_z[2]};
    double along_y[2] = {along_z[0] + y * by_y[0], along_z[2] + y * by_y[1]};
    double by_x = along_y[1] - along_y[0];
    if (slope) {
        double first = by_z[0] + y * (float)(by_z[1] - by_z[0]), second = by_z[2] + y * (float)(by_z[3] - by_z[2]);
        slope[0] = by_x;
        slope[1] = by_y[0] + x * (by_y[1] - by_y[0]);
        slope[2] = first + x * (second - first);
    }
    return along_y[0] + x * by_x;
}

static double clipped(double value, double most) { return value > 0.0 ? (value < most ? value : most) : 0.0; }

/* Distance of one point from a solid on a regular grid. */
double grid_distance(const Grid *grid, const double *point, double *slope)
{
    double place[3], beyond[3];
    int64_t first[3];
    int outside = 0;
    for (int axis = 0; axis < 3; axis++) {
        double at = (point[axis] - grid->origin[axis]) / grid->step;
        double inside = clipped(at, (double)(grid->shape[axis] - 1));
        first[axis] = (int64_t)inside;
        if (first[axis] > grid->shape[axis] - 2) first[axis] = grid->shape[axis] - 2;
        place[axis] = inside - (double)first[axis];
        beyond[axis] = (at - inside) * grid->step;
        outside |= beyond[axis] != 0.0;
    }
    int64_t down = grid->shape[2], across = grid->shape[1] * down;
    const float *from = grid->values + (first[0] * across + first[1] * down + first[2]);
    float corner[8];
    for (int k = 0; k < 8; k++) corner[k] = from[(k >> 2) * across + (k >> 1 & 1) * down + (k & 1)];
    double distance = between(corner, place[0], place[1], place[2], slope);
    if (slope)
        for (int axis = 0; axis < 3; axis++) slope[axis] /= grid->step;
    if (!outside) return distance;
    double away = sqrt(beyond[0] * beyond[0] + beyond[1] * beyond[1] + beyond[2] * beyond[2]);
    if (slope)
        for (int axis = 0; axis < 3; axis++)
            slope[axis] = (beyond[axis] != 0.0 ? 0.0 : slope[axis]) + beyond[axis] / (away > 1e-12 ? away : 1e-12);
    return distance + away;
}

/* Distance of one point from a surface sampled in cells of different fineness. */
double field_distance(const Field *field, const double *point, double *slope)
{
    double in_cell[3], beyond[3];
    int64_t cell[3];
    int outside = 0;
    for (int axis = 0; axis < 3; axis++) {
        double at = (point[axis] - field->origin[axis]) / field->edge;
        double inside = clipped(at, (double)field->counts[axis] * last_place);
        cell[axis] = (int64_t)inside;
        in_cell[axis] = inside - (double)cell[axis];
        beyond[axis] = (at - inside) * field->edge;
        outside |= beyond[axis] != 0.0;
    }
    int64_t index = (cell[0] * field->counts[1] + cell[1]) * field->counts[2] + cell[2];
    int64_t steps = (int64_t)1 << field->levels[index], nodes = steps + 1;
    double place[3];
    int64_t local[3];
    for (int axis = 0; axis < 3; axis++) {
        place[axis] = in_cell[axis] * (double)steps;
        local[axis] = (int64_t)place[axis];
        place[axis] -= (double)local[axis];
    }
    const float *from = field->samples + field->starts[index] + ((local[0] * nodes + local[1]) * nodes + local[2]);
    float corner[8];
    for (int k = 0; k < 8; k++) corner[k] = from[((k >> 2) * nodes + (k >> 1 & 1)) * nodes + (k & 1)];
    double distance = between(corner, place[0], place[1], place[2], slope);
    if (slope)
        for (int axis = 0; axis < 3; axis++) slope[axis] *= (double)steps / field->edge;
    if (!outside) return distance;
    double longer = sqrt(distance * distance + (beyond[0] * beyond[0] + beyond[1] * beyond[1] + beyond[2] * beyond[2]));
    if (slope)
        for (int axis = 0; axis < 3; axis++)
            slope[axis] = (beyond[axis] == 0.0 ? distance * slope[axis] : beyond[axis]) / longer;
    return longer;
}
