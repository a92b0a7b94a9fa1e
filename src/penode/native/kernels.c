/* Kernels that XLA calls through its C interface for foreign functions; doubles, batch last.

   Each has a twin in JAX, which runs where no C compiler is at hand, and which it is tested against. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "xla/ffi/api/c_api.h"

#define EXPORT __attribute__((visibility("default")))

/* XLA asks a handler once for the version it was compiled for. */
static int answered(XLA_FFI_CallFrame *frame) {
  __typeof__(frame->extension_start) extension = frame->extension_start; /* renamed in jaxlib 0.11 */
  if (extension == NULL || extension->type != XLA_FFI_Extension_Metadata) return 0;
  XLA_FFI_Metadata *metadata = ((XLA_FFI_Metadata_Extension *)extension)->metadata;
  metadata->api_version.major_version = XLA_FFI_API_MAJOR;
  metadata->api_version.minor_version = XLA_FFI_API_MINOR;
  return 1;
}

static XLA_FFI_Error *out_of_memory(XLA_FFI_CallFrame *frame) {
  XLA_FFI_Error_Create_Args error = {XLA_FFI_Error_Create_Args_STRUCT_SIZE, NULL, "out of memory",
                                     XLA_FFI_Error_Code_RESOURCE_EXHAUSTED};
  return frame->api->XLA_FFI_Error_Create(&error);
}

static XLA_FFI_Buffer *argument(XLA_FFI_CallFrame *frame, int k) { return frame->args.args[k]; }
static XLA_FFI_Buffer *result(XLA_FFI_CallFrame *frame, int k) { return frame->rets.rets[k]; }

/* --- tensor splines ------------------------------------------------------------------------- */

enum { SPLINES = 5, LANES = 8, DERIVATIVES = 4 }; /* quartic: five of them differ from zero */

typedef double Four __attribute__((vector_size(32)));
/* The same in an array of doubles: a copy by memcpy would go through the stack, and wait for it. */
typedef double FourAnywhere __attribute__((vector_size(32), aligned(8), may_alias));
/* A number a spline, in two halves: no compiler splits wider vectors well for all processors. */
typedef struct {
  Four low, high;
} Row;

static Four of_four(double x) { return (Four){x, x, x, x}; }

/* left + factor * right */
static Row plus(Row left, double factor, Row right) {
  Four each = of_four(factor);
  return (Row){left.low + each * right.low, left.high + each * right.high};
}

/* The polynomial pieces of one axis, (cell, power, lane), and the ends of the cells. */
typedef struct {
  const double *pieces, *breaks;
  int64_t cells;
} Axis;

/* Splines at one place, (derivative, lane); the first of them is number `first`. */
typedef struct {
  union {
    Row rows[DERIVATIVES];
    double of[DERIVATIVES][LANES];
  };
  int64_t first;
} Splines;

/* One half of the lanes of the splines' derivatives, `t` into a cell and `beyond` past the last. */
static void half_at(const double *pieces, double t, double beyond, Four half[DERIVATIVES]) {
  Four c[SPLINES], at = of_four(t), on = of_four(beyond);
  for (int k = 0; k < SPLINES; k++) c[k] = *(const FourAnywhere *)(pieces + k * LANES);
  half[0] = c[0] + at * (c[1] + at * (c[2] + at * (c[3] + at * c[4])));
  half[1] = c[1] + at * (2 * c[2] + at * (3 * c[3] + at * (4 * c[4])));
  half[2] = 2 * c[2] + at * (6 * c[3] + at * (12 * c[4]));
  half[3] = 6 * c[3] + at * (24 * c[4]);
  if (beyond != 0.0) { /* on along the parabola that touches at the end */
    half[0] += on * (half[1] + 0.5 * on * half[2]);
    half[1] += on * half[2];
    half[3] *= 0.0;
  }
}

static void splines_at(Axis axis, double x, Splines *splines) {
  double inside = x < -1.0 ? -1.0 : x > 1.0 ? 1.0 : x;
  int64_t cell = 0;
  for (int64_t k = 1; k < axis.cells; k++) cell += inside >= axis.breaks[k];
  const double *pieces = axis.pieces + cell * SPLINES * LANES;
  double t = inside - axis.breaks[cell], beyond = x - inside;
  Four low[DERIVATIVES], high[DERIVATIVES];
  half_at(pieces, t, beyond, low);
  half_at(pieces + LANES / 2, t, beyond, high);
  for (int m = 0; m < DERIVATIVES; m++) splines->rows[m] = (Row){low[m], high[m]};
  splines->first = cell;
}

/* What both kernels are given: places, axes, orders of differentiation, parities along q. */
typedef struct {
  const double *x;
  const int32_t *orders, *parities;
  int64_t batch, d, q, order_count, parity_count;
  Axis along_d, along_q;
} Problem;

static Problem problem_of(XLA_FFI_CallFrame *frame, int64_t d, int64_t q) {
  XLA_FFI_Buffer *x = argument(frame, 1), *pieces = argument(frame, 2);
  XLA_FFI_Buffer *breaks = argument(frame, 3), *orders = argument(frame, 4);
  XLA_FFI_Buffer *parities = argument(frame, 5);
  int64_t cells = breaks->dims[1] - 1;
  const double *of = pieces->data, *ends = breaks->data;
  Axis along_d = {of, ends, cells};
  Axis along_q = {of + cells * SPLINES * LANES, ends + cells + 1, cells};
  Problem p = {x->data, orders->data, parities->data, x->dims[1], d, q,
               orders->dims[0], parities->dims[0], along_d, along_q};
  return p;
}

/* Column and sign of each spline along q in a table folded by its symmetry; returns its columns. */
static int64_t fold(int64_t count, int64_t first, int even, int64_t *column, double *sign) {
  int64_t half = count / 2, middle = count - half;
  for (int64_t k = 0; k < SPLINES; k++) {
    int64_t j = first + k;
    int upper = j >= middle, centre = j >= half && !upper;
    column[k] = upper ? count - 1 - j : centre && !even ? 0 : j;
    sign[k] = even ? 1.0 : upper ? 1.0 : centre ? 0.0 : -1.0;
  }
  return even ? middle : half;
}

/* Derivatives of sum table[i, j] f_i(x_d) g_j(x_q): (d, q, batch or 1) to (order, batch). */
EXPORT XLA_FFI_Error *penode_spline_jets(XLA_FFI_CallFrame *frame) {
  if (answered(frame)) return NULL;
  XLA_FFI_Buffer *table = argument(frame, 0);
  Problem p = problem_of(frame, table->dims[0], table->dims[1]);
  int64_t apart = table->dims[2], own = apart > 1;
  double *jets = result(frame, 0)->data;
  for (int64_t b = 0; b < p.batch; b++) {
    Splines d, q;
    splines_at(p.along_d, p.x[b], &d);
    splines_at(p.along_q, p.x[p.batch + b], &q);
    Four by_spline[SPLINES], rows[SPLINES] = {{0}};
    for (int j = 0; j < SPLINES; j++)
      by_spline[j] = (Four){q.of[0][j], q.of[1][j], q.of[2][j], q.of[3][j]};
    int64_t before = 0;
    for (int64_t s = 0; s < p.parity_count; s++) {
      int64_t column[SPLINES];
      double sign[SPLINES];
      int64_t width = fold(p.d, q.first, p.parities[s], column, sign);
      for (int j = 0; j < SPLINES; j++) {
        Four factor = of_four(sign[j]) * by_spline[j];
        const double *entry = table->data;
        entry += (d.first * p.q + before + column[j]) * apart + own * b;
        for (int i = 0; i < SPLINES; i++) rows[i] += of_four(entry[i * p.q * apart]) * factor;
      }
      before += width;
    }
    Four every[DERIVATIVES];
    for (int m = 0; m < DERIVATIVES; m++) {
      every[m] = of_four(d.of[m][0]) * rows[0];
      for (int i = 1; i < SPLINES; i++) every[m] += of_four(d.of[m][i]) * rows[i];
    }
    for (int64_t k = 0; k < p.order_count; k++)
      jets[k * p.batch + b] = every[p.orders[2 * k]][p.orders[2 * k + 1]];
  }
  return NULL;
}

/* Adds the products at one place, cotangents and table `batch` apart. */
static void add_product(const Problem *p, const Splines *d, const Splines *q,
                        const double *cotangents, double *table) {
  Row rows[DERIVATIVES] = {{{0}, {0}}};
  union {
    Row row;
    double of[LANES];
  } products[SPLINES] = {{{{0}, {0}}}};
  for (int64_t k = 0; k < p->order_count; k++) {
    Row *row = rows + p->orders[2 * k];
    *row = plus(*row, cotangents[k * p->batch], q->rows[p->orders[2 * k + 1]]);
  }
  for (int i = 0; i < SPLINES; i++)
    for (int m = 0; m < DERIVATIVES; m++)
      products[i].row = plus(products[i].row, d->of[m][i], rows[m]);
  int64_t before = 0;
  for (int64_t s = 0; s < p->parity_count; s++) {
    int64_t column[SPLINES];
    double sign[SPLINES];
    int64_t width = fold(p->d, q->first, p->parities[s], column, sign);
    for (int i = 0; i < SPLINES; i++)
      for (int j = 0; j < SPLINES; j++)
        table[((d->first + i) * p->q + before + column[j]) * p->batch] += sign[j] * products[i].of[j];
    before += width;
  }
}

/* The transpose: cotangents (many, order, batch) to one table a place, (many, d, q, batch). */
EXPORT XLA_FFI_Error *penode_spline_products(XLA_FFI_CallFrame *frame) {
  if (answered(frame)) return NULL;
  XLA_FFI_Buffer *tables = result(frame, 0);
  Problem p = problem_of(frame, tables->dims[1], tables->dims[2]);
  const double *cotangents = argument(frame, 0)->data;
  int64_t many = tables->dims[0], size = p.d * p.q * p.batch;
  memset(tables->data, 0, sizeof(double) * many * size);
  for (int64_t b = 0; b < p.batch; b++) {
    Splines d, q;
    splines_at(p.along_d, p.x[b], &d);
    splines_at(p.along_q, p.x[p.batch + b], &q);
    for (int64_t one = 0; one < many; one++)
      add_product(&p, &d, &q, cotangents + one * p.order_count * p.batch + b,
                  (double *)tables->data + one * size + b);
  }
  return NULL;
}

/* --- harmonics ------------------------------------------------------------------------------ */

/* Cosines, then sines, of multiples of angles: (batch) to (2 order, batch). */
EXPORT XLA_FFI_Error *penode_harmonics(XLA_FFI_CallFrame *frame) {
  if (answered(frame)) return NULL;
  XLA_FFI_Buffer *angles = argument(frame, 0), *orders = argument(frame, 1);
  const double *angle = angles->data, *order = orders->data;
  double *waves = result(frame, 0)->data;
  int64_t batch = angles->dims[0], count = orders->dims[0];
  for (int64_t k = 0; k < count; k++)
    for (int64_t b = 0; b < batch; b++) {
      waves[k * batch + b] = cos(order[k] * angle[b]);
      waves[(count + k) * batch + b] = sin(order[k] * angle[b]);
    }
  return NULL;
}

/* --- the normal matrix ---------------------------------------------------------------------- */

#ifdef __AVX512F__
enum { WIDTH = 8, TALL = 8 };
#else
enum { WIDTH = 4, TALL = 4 };
#endif
enum { VECTORS = 3, WIDE = VECTORS * WIDTH }; /* as many sums as there are registers for */
typedef double Vector __attribute__((vector_size(8 * WIDTH)));
typedef double VectorAnywhere __attribute__((vector_size(8 * WIDTH), aligned(8), may_alias));

/* The columns of a batch's slopes that are not zero throughout: splines far away leave many so.
   Panels are (depth, WIDE), one behind the other for each WIDE columns, so that a tile's factors
   stay in the first cache. */
typedef struct {
  double *panels;
  int64_t *column; /* where each one stands among all */
  int64_t count, depth, size;
} Active;

/* Adds `sign` times the tile of the product that begins at a row and a column of the active ones. */
static void add_tile(Active a, int64_t row, int64_t column, double sign, double *normal) {
  Vector sums[TALL][VECTORS] = {{{0}}};
  double tile[TALL][WIDE];
  const double *left = a.panels + row / WIDE * WIDE * a.depth + row % WIDE;
  const double *right = a.panels + column * a.depth;
  for (int64_t k = 0; k < a.depth; k++) {
    const VectorAnywhere *every = (const VectorAnywhere *)(right + k * WIDE);
    Vector one = every[0], two = every[1], three = every[2];
#pragma GCC unroll 8
    for (int i = 0; i < TALL; i++) {
      double factor = left[k * WIDE + i];
      sums[i][0] += factor * one;
      sums[i][1] += factor * two;
      sums[i][2] += factor * three;
    }
  }
#pragma GCC unroll 8
  for (int i = 0; i < TALL; i++) memcpy(tile[i], sums[i], sizeof sums[i]);
  int64_t rows = a.count - row < TALL ? a.count - row : TALL;
  int64_t columns = a.count - column < WIDE ? a.count - column : WIDE;
  const int64_t *at = a.column + column;
  for (int64_t i = 0; i < rows; i++) {
    double *to = normal + a.column[row + i] * a.size;
    if (columns == WIDE && at[WIDE - 1] == at[0] + WIDE - 1)
      for (int64_t j = 0; j < WIDE; j++) to[at[0] + j] += sign * tile[i][j];
    else
      for (int64_t j = 0; j < columns; j++) to[at[j]] += sign * tile[i][j];
  }
}

static int all_zero(const double *x, int64_t count) {
  for (int64_t k = 0; k < count; k++)
    if (x[k] != 0.0) return 0; /* nor is nan */
  return 1;
}

/* normal += sign * sum over outputs and batch of s s' on and below the diagonal, the sign -1, 0 or 1;
   s (output, size, batch). */
EXPORT XLA_FFI_Error *penode_add_products(XLA_FFI_CallFrame *frame) {
  if (answered(frame)) return NULL;
  XLA_FFI_Buffer *before = argument(frame, 0), *slopes = argument(frame, 2);
  int32_t sign = *(const int32_t *)argument(frame, 1)->data;
  double *normal = result(frame, 0)->data;
  const double *from = slopes->data;
  int64_t outputs = slopes->dims[0], size = slopes->dims[1], batch = slopes->dims[2];
  Active a = {NULL, NULL, 0, outputs * batch, size};
  if (normal != before->data) memcpy(normal, before->data, sizeof(double) * size * size);
  if (sign == 0) return NULL;
  a.panels = calloc(a.depth * (size + WIDE), sizeof(double));
  a.column = malloc(sizeof(int64_t) * (size + 1));
  if (a.panels == NULL || a.column == NULL) {
    free(a.panels), free(a.column);
    return out_of_memory(frame);
  }
  for (int64_t j = 0; j < size; j++) {
    int zero = 1;
    for (int64_t o = 0; o < outputs && zero; o++) zero = all_zero(from + (o * size + j) * batch, batch);
    if (zero) continue;
    double *to = a.panels + a.count / WIDE * WIDE * a.depth + a.count % WIDE;
    for (int64_t o = 0; o < outputs; o++)
      for (int64_t b = 0; b < batch; b++, to += WIDE) *to = from[(o * size + j) * batch + b];
    a.column[a.count++] = j;
  }
  for (int64_t row = 0; row < a.count; row += TALL)
    for (int64_t column = 0; column < a.count && column < row + TALL; column += WIDE)
      add_tile(a, row, column, sign, normal);
  free(a.panels), free(a.column);
  return NULL;
}
