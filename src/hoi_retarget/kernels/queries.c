/* Distances of many points, in one frame or on links that move. */

#include <math.h>
#include <stddef.h>
#include "kernels.h"

/* Point `k` is at `points[k * along + axis * across]`; slopes are (3, count), or NULL. */
#define QUERY(NAME, SHAPE, DISTANCE)                                                                                  \
    EXPORTED void NAME(const SHAPE *shape, const double *points, whole along, whole across, whole count,              \
                       double *distances, double *slopes)                                                             \
    {                                                                                                                 \
        for (whole k = 0; k < count; k++) {                                                                           \
            const double *at = points + k * along;                                                                    \
            double point[3] = {at[0], at[across], at[2 * across]}, slope[3];                                          \
            distances[k] = DISTANCE(shape, point, slopes ? slope : NULL);                                             \
            if (slopes)                                                                                               \
                for (int axis = 0; axis < 3; axis++) slopes[axis * count + k] = slope[axis];                          \
        }                                                                                                             \
    }

QUERY(grid_query, Grid, grid_distance)
QUERY(field_query, Field, field_distance)

typedef struct {
    double rotation[9], position[3];
} Pose;

/* Pose in one of T frames, from arrays (3, 3, T) and (3, T). */
static Pose pose_at(const double *rotation, const double *position, whole frames, whole frame)
{
    Pose pose;
    for (int k = 0; k < 9; k++) pose.rotation[k] = rotation[k * frames + frame];
    for (int k = 0; k < 3; k++) pose.position[k] = position[k * frames + frame];
    return pose;
}

static void turned(const Pose *pose, const double *vector, double *out)
{
    for (int i = 0; i < 3; i++)
        out[i] = pose->rotation[3 * i] * vector[0] + pose->rotation[3 * i + 1] * vector[1] +
                 pose->rotation[3 * i + 2] * vector[2];
}

static void turned_back(const Pose *pose, const double *vector, double *out)
{
    for (int i = 0; i < 3; i++)
        out[i] = pose->rotation[i] * vector[0] + pose->rotation[3 + i] * vector[1] + pose->rotation[6 + i] * vector[2];
}

/* Skin points (3, K, F) of a link, in its frame, at an object: levers in world axes, distances (K, F), normals in world
   axes. Poses are of T frames, of which `chosen` are the F. */
EXPORTED void skin_points(const Field *field, const double *link_rotation, const double *link_position,
                          const double *object_rotation, const double *object_position, whole frames,
                          const whole *chosen, whole count, const double *points, whole each, double *levers,
                          double *distances, double *normals)
{
    whole all = each * count;
    for (whole f = 0; f < count; f++) {
        Pose link = pose_at(link_rotation, link_position, frames, chosen[f]);
        Pose object = pose_at(object_rotation, object_position, frames, chosen[f]);
        for (whole k = 0; k < each; k++) {
            whole at = k * count + f;
            double point[3] = {points[at], points[all + at], points[2 * all + at]};
            double lever[3], way[3], inside[3], slope[3], normal[3];
            turned(&link, point, lever);
            for (int i = 0; i < 3; i++) way[i] = link.position[i] + lever[i] - object.position[i];
            turned_back(&object, way, inside);
            distances[at] = field_distance(field, inside, slope);
            turned(&object, slope, normal);
            for (int i = 0; i < 3; i++) {
                levers[i * all + at] = lever[i];
                normals[i * all + at] = normal[i];
            }
        }
    }
}

/* World points (3, K, F) at a link's solid: levers, distances (K, F), and how the link must move for these to grow. */
EXPORTED void solid_points(const Grid *solid, const double *link_rotation, const double *link_position, whole frames,
                           const whole *chosen, whole count, const double *points, whole each, double *levers,
                           double *distances, double *away)
{
    whole all = each * count;
    for (whole f = 0; f < count; f++) {
        Pose link = pose_at(link_rotation, link_position, frames, chosen[f]);
        for (whole k = 0; k < each; k++) {
            whole at = k * count + f;
            double lever[3], inside[3], slope[3], out[3];
            for (int i = 0; i < 3; i++) levers[i * all + at] = lever[i] = points[i * all + at] - link.position[i];
            turned_back(&link, lever, inside);
            distances[at] = grid_distance(solid, inside, slope);
            turned(&link, slope, out);
            for (int i = 0; i < 3; i++) away[i * all + at] = -out[i];
        }
    }
}

/* `hinge_rows` of `skin_points.py`: residuals (K, F), their derivatives (K, 3, F) by the link's velocities. */
EXPORTED void hinge(const double *levers, const double *distances, const double *normals, const double *margins,
                    double margin, double knee, whole each, whole count, double *residual, double *by_linear,
                    double *by_angular)
{
    whole all = each * count;
    for (whole k = 0; k < each; k++)
        for (whole f = 0; f < count; f++) {
            whole at = k * count + f;
            double depth = (margins ? margins[at] : margin) - distances[at], slope = 1.0;
            if (!(depth > 0.0)) {
                residual[at] = 0.0;
                for (int i = 0; i < 3; i++) by_linear[(3 * k + i) * count + f] = by_angular[(3 * k + i) * count + f] = 0.0;
                continue;
            }
            residual[at] = -depth;
            if (depth > knee) {
                double root = sqrt(knee * (2.0 * depth - knee));
                residual[at] = -root;
                slope = knee / root;
            }
            const double *l = levers + at;
            double x = l[0], y = l[all], z = l[2 * all];
            double a = slope * normals[at], b = slope * normals[all + at], c = slope * normals[2 * all + at];
            double *linear = by_linear + 3 * k * count + f, *angular = by_angular + 3 * k * count + f;
            linear[0] = a, linear[count] = b, linear[2 * count] = c;
            angular[0] = y * c - z * b, angular[count] = z * a - x * c, angular[2 * count] = x * b - y * a;
        }
}

/* Points (K, 3) of one link in the solid of another, or not as far from it as `margin`, in the F `chosen` of T frames:
   frame (an index into `chosen`), place in the solid's frame, depth, and slopes of the distance. Each point has one of the
   first `coarse` of them as its neighbour, `away` from it: where that is far, so is the point. Beyond its grid a solid may
   overrate distances by a factor of `overrated`. Returns their number. */
EXPORTED whole meeting(const Grid *solid, const double *points, whole total, whole coarse, const whole *neighbour,
                       const double *away, double farthest, const double *link_rotation, const double *link_position,
                       const double *other_rotation, const double *other_position, whole frames, const whole *chosen,
                       whole count, double margin, double overrated, whole *times, double *places, double *depths,
                       double *slopes)
{
    whole found = 0;
    double *rough = depths + count * total; /* Behind all that may be found. */
    for (whole f = 0; f < count; f++) {
        Pose link = pose_at(link_rotation, link_position, frames, chosen[f]);
        Pose other = pose_at(other_rotation, other_position, frames, chosen[f]);
        double turn[9], offset[3], way[3], least = INFINITY;
        for (int i = 0; i < 3; i++) way[i] = link.position[i] - other.position[i];
        turned_back(&other, way, offset);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                turn[3 * i + j] = other.rotation[i] * link.rotation[j] + other.rotation[3 + i] * link.rotation[3 + j] +
                                  other.rotation[6 + i] * link.rotation[6 + j];
        for (whole k = 0; k < total; k++) {
            if (k == coarse && least >= margin + overrated * farthest) break;
            if (k >= coarse && rough[neighbour[k]] >= margin + overrated * away[k]) continue;
            double *place = places + 3 * found;
            const double *p = points + 3 * k;
            for (int i = 0; i < 3; i++)
                place[i] = turn[3 * i] * p[0] + turn[3 * i + 1] * p[1] + turn[3 * i + 2] * p[2] + offset[i];
            double distance = grid_distance(solid, place, NULL);
            if (k < coarse) {
                rough[k] = distance;
                if (distance < least) least = distance;
            }
            if (margin - distance <= 0.0) continue;
            grid_distance(solid, place, slopes + 3 * found);
            depths[found] = margin - distance;
            times[found++] = f;
        }
    }
    return found;
}
