/* Layouts are those of the arrays in Python: C order, time last where a comment does not say otherwise. */

#ifndef HOI_RETARGET_KERNELS_H
#define HOI_RETARGET_KERNELS_H

#include <stdint.h>

#ifdef _WIN32
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

typedef int64_t whole;

/* A solid on a regular grid (`DistanceGrid`). */
typedef struct {
    double origin[3], step;
    whole shape[3];
    const float *values;
} Grid;

/* A surface sampled in cells of different fineness (`objects/distance_field.py`). */
typedef struct {
    double origin[3], edge;
    whole counts[3];
    const int8_t *levels;
    const whole *starts;
    const float *samples;
} Field;

/* Points of a surface, sorted by cubic cells, z running fastest; `indices` tell their places before. */
typedef struct {
    double origin[3], edge;
    whole counts[3], total;
    const whole *starts, *indices;
    const double *points;
} Samples;

/* Distance of one point [m]; its derivatives by the point, where `slope` is not NULL. */
double grid_distance(const Grid *grid, const double *point, double *slope);
double field_distance(const Field *field, const double *point, double *slope);

#endif
