"""The text of the C header around its tables, for `string.Template`."""

from string import Template

HEADER = Template("""\
/*
 * Flux-linkage map of a permanent-magnet synchronous machine, written by penode.
 *
 * Currents in A (peak value of a phase, rotor frame), flux linkages in Vs, inductances in H.
 * Even grid: ${range}.
${temperatures}
 * Bilinear between its points, clamped at its edges.
 * The tables are static: include this header in one translation unit.
 */
#ifndef ${NAME}_H
#define ${NAME}_H

#include <stdint.h>

#define ${NAME}_ROWS (${rows})
#define ${NAME}_COLUMNS (${columns})
${constants}
typedef struct
{
    float psi_d;
    float psi_q;
} ${name}_flux_t;

typedef struct
{
    float l_dd;
    float l_dq;
    float l_qd;
    float l_qq;
} ${name}_inductance_t;

/* A cell of the grid, and where in it the currents lie: 0 to 1. */
typedef struct
{
    uint32_t row;
    uint32_t column;
    float along_d;
    float along_q;
} ${name}_cell_t;

/* One row an i_d, in it one entry an i_q. */
static const ${name}_flux_t ${name}_flux_table[${NAME}_ROWS][${NAME}_COLUMNS] = {
${flux}
};

static const ${name}_inductance_t ${name}_inductance_table[${NAME}_ROWS][${NAME}_COLUMNS] = {
${inductance}
};

/* 1 where recordings have been; elsewhere the map is an extrapolation. */
static const uint8_t ${name}_supported_table[${NAME}_ROWS][${NAME}_COLUMNS] = {
${supported}
};

/* The position between 0 and last; 0 for what is not a number. */
static inline float ${name}_clamped(float position, float last)
{
    float inside = 0.0F;

    if (position >= last)
    {
        inside = last;
    }
    else if (position > 0.0F)
    {
        inside = position;
    }
    else
    {
        inside = 0.0F;
    }
    return inside;
}

static inline ${name}_cell_t ${name}_cell(float i_d, float i_q)
{
    const float d = ${name}_clamped((i_d * ${d_per_ampere}) + ${d_zero},
                                    (float)(${NAME}_ROWS - 1U));
    const float q = ${name}_clamped((i_q * ${q_per_ampere}) + ${q_zero},
                                    (float)(${NAME}_COLUMNS - 1U));
    ${name}_cell_t cell;

    cell.row = (uint32_t)d;
    cell.column = (uint32_t)q;
    if (cell.row > (${NAME}_ROWS - 2U))
    {
        cell.row = ${NAME}_ROWS - 2U;
    }
    if (cell.column > (${NAME}_COLUMNS - 2U))
    {
        cell.column = ${NAME}_COLUMNS - 2U;
    }
    cell.along_d = d - (float)cell.row;
    cell.along_q = q - (float)cell.column;
    return cell;
}

static inline float ${name}_between(float low, float high, float along)
{
    return low + (along * (high - low));
}

static inline ${name}_flux_t ${name}_flux_between(
    ${name}_flux_t low, ${name}_flux_t high, float along)
{
    ${name}_flux_t value;

    value.psi_d = ${name}_between(low.psi_d, high.psi_d, along);
    value.psi_q = ${name}_between(low.psi_q, high.psi_q, along);
    return value;
}

static inline ${name}_inductance_t ${name}_inductance_between(
    ${name}_inductance_t low, ${name}_inductance_t high, float along)
{
    ${name}_inductance_t value;

    value.l_dd = ${name}_between(low.l_dd, high.l_dd, along);
    value.l_dq = ${name}_between(low.l_dq, high.l_dq, along);
    value.l_qd = ${name}_between(low.l_qd, high.l_qd, along);
    value.l_qq = ${name}_between(low.l_qq, high.l_qq, along);
    return value;
}

/* Flux linkages in Vs at currents in A. */
static inline ${name}_flux_t ${name}_flux(float i_d, float i_q)
{
    const ${name}_cell_t at = ${name}_cell(i_d, i_q);
    const ${name}_flux_t low = ${name}_flux_between(
        ${name}_flux_table[at.row][at.column],
        ${name}_flux_table[at.row][at.column + 1U], at.along_q);
    const ${name}_flux_t high = ${name}_flux_between(
        ${name}_flux_table[at.row + 1U][at.column],
        ${name}_flux_table[at.row + 1U][at.column + 1U], at.along_q);

    return ${name}_flux_between(low, high, at.along_d);
}

/* Differential inductances in H at currents in A. */
static inline ${name}_inductance_t ${name}_inductance(float i_d, float i_q)
{
    const ${name}_cell_t at = ${name}_cell(i_d, i_q);
    const ${name}_inductance_t low = ${name}_inductance_between(
        ${name}_inductance_table[at.row][at.column],
        ${name}_inductance_table[at.row][at.column + 1U], at.along_q);
    const ${name}_inductance_t high = ${name}_inductance_between(
        ${name}_inductance_table[at.row + 1U][at.column],
        ${name}_inductance_table[at.row + 1U][at.column + 1U], at.along_q);

    return ${name}_inductance_between(low, high, at.along_d);
}

/* 1 where all four points around the currents are supported, else 0; beyond the edges too. */
static inline uint8_t ${name}_is_supported(float i_d, float i_q)
{
    const ${name}_cell_t at = ${name}_cell(i_d, i_q);
    const uint32_t low = (uint32_t)${name}_supported_table[at.row][at.column]
                       & (uint32_t)${name}_supported_table[at.row][at.column + 1U];
    const uint32_t high = (uint32_t)${name}_supported_table[at.row + 1U][at.column]
                        & (uint32_t)${name}_supported_table[at.row + 1U][at.column + 1U];
    uint8_t supported = 0U;

    if (${within})
    {
        supported = (uint8_t)(low & high);
    }
    return supported;
}

#endif /* ${NAME}_H */
""")
