/* Each function is compiled once per instruction set of a kind of processor; here is the list of the sets, and which of
 * them this processor has. Flags with which the functions would have other bits than numpy are refused. */
#include <float.h>

#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || \
    defined(__NO_SIGNED_ZEROS__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "compiled code and its numpy reference give the same bits only without -ffast-math and its parts"
#endif
#if !defined(FLT_EVAL_METHOD) || FLT_EVAL_METHOD != 0
#error "compiled code needs arithmetic that rounds every operation to its own type"
#endif
_Static_assert(0.1 != 0.1f, "compiled code needs constants of their own type: not -fsingle-precision-constant");

#if defined(__GNUC__) || defined(__clang__)
#define KERNEL_INLINE __attribute__((always_inline))
#define FETCH(place) __builtin_prefetch(place)
#define FETCH_TO_WRITE(place) __builtin_prefetch(place, 1)
#else
#define KERNEL_INLINE
#define FETCH(place) ((void)(place))
#define FETCH_TO_WRITE(place) ((void)(place))
#endif
#ifdef _MSC_VER
#define restrict __restrict
#pragma fp_contract(off)
#elif defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

#if defined(__GNUC__) && !defined(__clang__)
/* If two choices in a loop depend on one comparison, GCC duplicates all code between them, once per outcome, before it
 * vectorises the loop. That costs a twentieth of the time, and a quarter in unlucky cases. Flags that a compiler's wrapper
 * adds after those of setup.py must not contract a * b + c either. */
#pragma GCC optimize("no-thread-jumps", "fp-contract=off")
#endif

static int always(void) { return 1; }

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#include <cpuid.h>
#ifdef __clang__
#define WIDE
#else
#define WIDE ",prefer-vector-width=512"
#endif

/* Ask the processor itself, because not every compiler's runtime library provides __builtin_cpu_supports. */
static int has(unsigned saved_state, unsigned features) {
    unsigned eax, ebx, ecx, edx, low, high;
    if (!__get_cpuid(1, &eax, &ebx, &ecx, &edx) || !(ecx & bit_OSXSAVE)) return 0;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if ((low & saved_state) != saved_state || !__get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx)) return 0;
    return (ebx & features) == features;
}

/* Ask only once: on a virtual machine the answer takes as long as some thousand pixels. */
#define ONCE(question) \
    static int answer; \
    if (!answer) answer = 1 + (question); \
    return answer - 1;
static int has_avx512(void) { ONCE(has(0xe6, bit_AVX512F | bit_AVX512DQ | bit_AVX512BW | bit_AVX512VL)) }
static int has_avx2(void) { ONCE(has(0x06, bit_AVX2)) }
#define FOR_EACH_LEVEL(LEVEL)                                                                             \
    LEVEL(avx512, __attribute__((target("avx2,avx512f,avx512dq,avx512bw,avx512vl" WIDE))), has_avx512)   \
    LEVEL(avx2, __attribute__((target("avx2"))), has_avx2)                                               \
    LEVEL(sse2, , always)
#elif defined(__aarch64__) || defined(_M_ARM64)
#define FOR_EACH_LEVEL(LEVEL) LEVEL(neon, , always)
#else
#define FOR_EACH_LEVEL(LEVEL) LEVEL(plain, , always)
#endif
