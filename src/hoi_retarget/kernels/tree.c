/* Forward kinematics, and normal equations of rows that depend on the poses of frames. */

#include <math.h>
#include "kernels.h"

/* Poses (3, 3, N, T) and (3, N, T) of all nodes; those of the root are given. `turns` are `hinge_rotations` (3, 3, 3, n). */
EXPORTED void forward(const whole *parents, const double *offsets, const double *turns, const double *cosine,
                      const double *sine, whole hinges, whole frames, double *rotation, double *position)
{
    whole nodes = hinges + 1;
    for (whole h = 0; h < hinges; h++) {
        double constant[9], by_cosine[9], by_sine[9], offset[3];
        for (int k = 0; k < 9; k++) {
            constant[k] = turns[k * hinges + h];
            by_cosine[k] = turns[(9 + k) * hinges + h];
            by_sine[k] = turns[(18 + k) * hinges + h];
        }
        for (int k = 0; k < 3; k++) offset[k] = offsets[k * hinges + h];
        const double *c = cosine + h * frames, *s = sine + h * frames;
        for (whole t = 0; t < frames; t++) {
            double local[9];
            for (int k = 0; k < 9; k++) local[k] = constant[k] + by_cosine[k] * c[t] + by_sine[k] * s[t];
            for (int i = 0; i < 3; i++) {
                double row[3];
                for (int j = 0; j < 3; j++) row[j] = rotation[((3 * i + j) * nodes + parents[h]) * frames + t];
                for (int l = 0; l < 3; l++)
                    rotation[((3 * i + l) * nodes + h + 1) * frames + t] =
                        row[0] * local[l] + row[1] * local[3 + l] + row[2] * local[6 + l];
                position[(i * nodes + h + 1) * frames + t] = position[(i * nodes + parents[h]) * frames + t] +
                                                             (row[0] * offset[0] + row[1] * offset[1] + row[2] * offset[2]);
            }
        }
    }
}

/* Adds the rows (m, F) of one frame fixed to a node, at `levers` (3, T) from the root, to the node's matrix and force in
   the space of twists at the root. Matrices are (T, N, 6, 6), forces (T, N, 6): one frame's fit into a cache. */
EXPORTED void add_rows(double *matrices, double *forces, whole nodes, whole node, const double *residual,
                       const double *by_linear, const double *by_angular, const double *levers, whole frames,
                       const whole *chosen, const double *weights, double weight, whole rows, whole count)
{
    for (whole f = 0; f < count; f++) {
        whole t = chosen ? chosen[f] : f;
        double *matrix = matrices + (t * nodes + node) * 36, *force = forces + (t * nodes + node) * 6;
        double own = weights ? weights[f] : weight, x = 0.0, y = 0.0, z = 0.0;
        if (by_linear) x = levers[t], y = levers[frames + t], z = levers[2 * frames + t];
        for (whole m = 0; m < rows; m++) {
            double jacobian[6] = {0.0};
            if (by_linear) {
                const double *by = by_linear + 3 * m * count + f;
                double a = by[0], b = by[count], c = by[2 * count];
                jacobian[0] = a, jacobian[1] = b, jacobian[2] = c;
                jacobian[3] = y * c - z * b, jacobian[4] = z * a - x * c, jacobian[5] = x * b - y * a;
            }
            if (by_angular)
                for (int i = 0; i < 3; i++) jacobian[3 + i] += by_angular[(3 * m + i) * count + f];
            double any = 0.0;
            for (int i = 0; i < 6; i++) any += fabs(jacobian[i]);
            if (any == 0.0) continue; /* A hinge that is not reached. */
            double pull = own * residual[m * count + f];
            for (int a = 0; a < 6; a++) {
                double weighted = own * jacobian[a];
                force[a] += pull * jacobian[a];
                for (int b = 0; b <= a; b++) matrix[6 * a + b] += weighted * jacobian[b];
            }
        }
    }
}

/* Adds the matrices and forces of all nodes to the band (T, nv, width) and the gradient (T, nv). `axes` (6, nv, T) are
   the twists of the coordinates, `column_nodes` the nodes that these move first; their first `coupled[r]` entries of
   row r of `columns` are the coordinates that move that of r, too. */
EXPORTED void add_tree(double *matrices, double *forces, const whole *parents, whole nodes, const double *axes,
                       const whole *column_nodes, const whole *columns, const whole *coupled, whole nv, whole frames,
                       whole width, double *band, double *gradient)
{
    double twists[256][6];
    for (whole t = 0; t < frames; t++) {
        double *matrix = matrices + t * nodes * 36, *force = forces + t * nodes * 6;
        for (whole n = nodes - 1; n > 0; n--) {
            whole parent = parents[n - 1];
            for (int k = 0; k < 36; k++) matrix[parent * 36 + k] += matrix[n * 36 + k];
            for (int k = 0; k < 6; k++) force[parent * 6 + k] += force[n * 6 + k];
        }
        for (whole n = 0; n < nodes; n++)
            for (int a = 0; a < 6; a++)
                for (int b = a + 1; b < 6; b++) matrix[n * 36 + 6 * a + b] = matrix[n * 36 + 6 * b + a];
        for (whole c = 0; c < nv; c++)
            for (int a = 0; a < 6; a++) twists[c][a] = axes[(a * nv + c) * frames + t];
        for (whole r = 0; r < nv; r++) {
            const double *own = matrix + column_nodes[r] * 36, *wrench = force + column_nodes[r] * 6;
            double momentum[6], along = 0.0;
            for (int a = 0; a < 6; a++) {
                momentum[a] = 0.0;
                for (int b = 0; b < 6; b++) momentum[a] += own[6 * a + b] * twists[r][b];
                along += wrench[a] * twists[r][a];
            }
            gradient[t * nv + r] += along;
            for (whole k = 0; k < coupled[r]; k++) {
                whole c = columns[r * nv + k];
                double product = 0.0;
                for (int a = 0; a < 6; a++) product += twists[c][a] * momentum[a];
                band[(t * nv + c) * width + r - c] += product;
            }
        }
    }
}
