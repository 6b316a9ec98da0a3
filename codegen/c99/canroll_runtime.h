/* What the firmware needs of the machine: fixed-width integers and operations on them. */
#ifndef CANROLL_RUNTIME_H
#define CANROLL_RUNTIME_H

#include <stdint.h>

/* The code relies on a right shift that keeps the sign, as every target's compiler has it. */
#if (-1 >> 1) != -1
#error "the right shift of a negative number must keep its sign"
#endif

/* v, limited to [lo, hi]. */
static inline int32_t canroll_clamp(int64_t v, int32_t lo, int32_t hi)
{
    return (v > hi) ? hi : ((v < lo) ? lo : (int32_t)v);
}

/* v, limited to [lo, hi], where v has 32 bits. */
static inline int32_t canroll_clamp32(int32_t v, int32_t lo, int32_t hi)
{
    return (v > hi) ? hi : ((v < lo) ? lo : v);
}

/* v, which is known not to be below the range of int32_t, limited to at most hi. */
static inline int32_t canroll_at_most(int64_t v, int32_t hi)
{
    return (v > hi) ? hi : (int32_t)v;
}

/* v, which is known not to be above the range of int32_t, limited to at least lo. */
static inline int32_t canroll_at_least(int64_t v, int32_t lo)
{
    return (v < lo) ? lo : (int32_t)v;
}

/* The same where v has 32 bits. */
static inline int32_t canroll_at_most32(int32_t v, int32_t hi)
{
    return (v > hi) ? hi : v;
}

static inline int32_t canroll_at_least32(int32_t v, int32_t lo)
{
    return (v < lo) ? lo : v;
}

/* v, limited to the range of int32_t. */
static inline int32_t canroll_sat32(int64_t v)
{
    int32_t low = (int32_t)v;
    return (low == v) ? low : ((v < 0) ? INT32_MIN : INT32_MAX);
}

/* v, limited to 31 bits: -2^30 to 2^30 - 1. An ARM has an instruction for it. */
static inline int32_t canroll_sat31_32(int32_t v)
{
    return (v > 0x3FFFFFFF) ? 0x3FFFFFFF : ((v < -0x40000000) ? -0x40000000 : v);
}

/* The same where v has 64 bits. */
static inline int32_t canroll_sat31(int64_t v)
{
    return canroll_sat31_32(canroll_sat32(v));
}

/* The magnitude of v, which is not the lowest number there is. */
static inline int64_t canroll_abs(int64_t v)
{
    return (v < 0) ? -v : v;
}

/* The same where v has 32 bits. */
static inline int32_t canroll_abs32(int32_t v)
{
    return (v < 0) ? -v : v;
}

/* v / 2^n rounded to nearest, halves upwards, for a constant n; 1 <= n <= 62. */
static inline int64_t canroll_rsh(int64_t v, int32_t n)
{
    return (v + ((int64_t)1 << (n - 1))) >> n;
}

/* The same for an n that the compiler doesn't know: one long shift instead of two. */
static inline int64_t canroll_rsh_by(int64_t v, int32_t n)
{
    return ((v >> (n - 1)) + 1) >> 1;
}

/* v / 2^n rounded to nearest, halves upwards, where v has 32 bits and room for the rounding. */
static inline int32_t canroll_rsh32(int32_t v, int32_t n)
{
    return (v + ((int32_t)1 << (n - 1))) >> n;
}

/* The same for any v; 2 <= n <= 31. */
static inline int32_t canroll_rsh32_by(int32_t v, int32_t n)
{
    return ((v >> (n - 1)) + 1) >> 1;
}

/* v / 2^n rounded to nearest, halves upwards, and limited to 31 bits; 1 <= n <= 62. */
static inline int32_t canroll_scaled(int64_t v, int32_t n)
{
    return canroll_sat32((v >> (n - 1)) + 1) >> 1;
}

/* A word of a record, whatever fields lie in it. */
#if defined(__GNUC__)
typedef int32_t canroll_any_word __attribute__((may_alias));
#else
typedef int32_t canroll_any_word;
#endif

/* The low eight bits of v. */
static inline uint8_t canroll_byte(int32_t v)
{
    return (uint8_t)((uint32_t)v & 255u);
}

/* The same where v has 64 bits. */
static inline uint8_t canroll_byte64(int64_t v)
{
    return (uint8_t)((uint64_t)v & 255u);
}

/* v in 64 bits. */
static inline int64_t canroll_wide(int32_t v)
{
    return v;
}

/* The same where v has no sign. */
static inline int64_t canroll_wide_u32(uint32_t v)
{
    return v;
}

/* v, which is known not to be negative, or its 32 bits. */
static inline uint32_t canroll_to_u32(int32_t v)
{
    return (uint32_t)v;
}

/* The number that has the 32 bits of v. */
static inline int32_t canroll_to_i32(uint32_t v)
{
    const uint32_t low = v & 0x7FFFFFFFu;
    return (low == v) ? (int32_t)v : ((int32_t)low + INT32_MIN);
}

/* Make a record of so many bytes, whole words, zero. */
static inline void canroll_clear(void *record, uint32_t bytes)
{
    volatile canroll_any_word *word = (volatile canroll_any_word *)record;
    for (uint32_t k = 0u; k < (bytes / 4u); k++) {
        word[k] = 0;
    }
}

/* Element k of a record read as an array of words. */
static inline int32_t canroll_word(const void *record, int32_t k)
{
    return ((const canroll_any_word *)record)[k];
}

/* Element k of a record read as an array of bytes. */
static inline uint8_t canroll_octet(const void *record, int32_t k)
{
    return ((const uint8_t *)record)[k];
}

/* The same of a record that an interrupt may write. */
static inline int32_t canroll_shared_word(const volatile void *record, int32_t k)
{
    return ((const volatile canroll_any_word *)record)[k];
}

static inline uint8_t canroll_shared_octet(const volatile void *record, int32_t k)
{
    return ((const volatile uint8_t *)record)[k];
}

/* Byte k of a record becomes v. */
static inline void canroll_set_octet(void *record, int32_t k, uint8_t v)
{
    ((uint8_t *)record)[k] = v;
}

/* Word k of a record becomes v. */
static inline void canroll_set_word(void *record, int32_t k, int32_t v)
{
    ((canroll_any_word *)record)[k] = v;
}

#endif
