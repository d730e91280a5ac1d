/* The ceiling: LIGHT-13 written by hand in the processor's vectors, with OpenMP over blocks of pixels.
 *
 * What makes it fast, beside planes and polynomials in place of logf and expf:
 *   - UNROLL vectors of pixels go through the light loop together, so that the long chain of one
 *     highlight does not stall the processor;
 *   - r.v is l.w, with w the direction to the eye mirrored at the normal, computed once per pixel;
 *   - reciprocals and their roots are estimates with a Newton step, and what is constant per light
 *     (twice the root, a light's one colour) is folded into constants;
 *   - lights behind the surface of all UNROLL vectors are skipped, and highlights below FAINT too
 *     (compile with -DDENSE=1 to compute all of them).
 * The gradient goes back through the lights with what the way forward left on the stack.
 */
#include <math.h>
#include <omp.h>
#include <stdint.h>

#ifndef DENSE
#define DENSE 0
#endif
#define INLINE static inline __attribute__((always_inline))
#define EACH for (int u = 0; u < UNROLL; u++)
#define BLOCK 2048   /* pixels that a thread takes at once; a multiple of WIDTH * UNROLL */
#define FAINT -24.0f /* log2 of the highlight, relative to its peak, that counts as none */

#if defined(__AVX512F__)
#define WIDTH 16
#define UNROLL 2
#elif defined(__AVX2__)
#define WIDTH 8
#define UNROLL 4
#else
#define WIDTH 4
#define UNROLL 4
#endif
#define GROUP (WIDTH * UNROLL)

typedef float V __attribute__((vector_size(4 * WIDTH)));
typedef int32_t I __attribute__((vector_size(4 * WIDTH)));

INLINE V all(float a) { return (V){0} + a; }

/* What has no operator: the larger, whether any lane is above, lanes where a > b, the nearest whole
 * number, 1 / x and 2 / sqrt(x). */
#if defined(__AVX512F__)
#include <immintrin.h>
INLINE V larger(V a, V b) { return _mm512_max_ps(a, b); }
INLINE int any_above(V a, float b) { return _mm512_cmp_ps_mask(a, all(b), _CMP_GT_OQ) != 0; }
INLINE V where_above(V a, V b, V v) {
    return _mm512_maskz_mov_ps(_mm512_cmp_ps_mask(a, b, _CMP_GT_OQ), v);
}
INLINE V whole(V x) { return _mm512_roundscale_ps(x, _MM_FROUND_TO_NEAREST_INT); }
INLINE V reciprocal(V x) {
    V y = _mm512_rcp14_ps(x);
    return y * (2.0f - x * y);
}
INLINE V twice_reciprocal_root(V x) {
    V y = _mm512_rsqrt14_ps(x);
    return y * (3.0f - (x * y) * y);
}
#elif defined(__AVX2__)
#include <immintrin.h>
INLINE V larger(V a, V b) { return _mm256_max_ps(a, b); }
INLINE int any_above(V a, float b) { return _mm256_movemask_ps((V)(a > b)); }
INLINE V where_above(V a, V b, V v) { return (V)((I)v & (a > b)); }
INLINE V whole(V x) { return _mm256_round_ps(x, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC); }
INLINE V reciprocal(V x) {
    V y = _mm256_rcp_ps(x);
    return y * (2.0f - x * y);
}
INLINE V twice_reciprocal_root(V x) {
    V y = _mm256_rsqrt_ps(x);
    return y * (3.0f - (x * y) * y);
}
#elif defined(__ARM_NEON) && defined(__aarch64__)
#include <arm_neon.h>
INLINE V larger(V a, V b) { return (V)vmaxq_f32((float32x4_t)a, (float32x4_t)b); }
INLINE int any_above(V a, float b) { return vmaxvq_f32((float32x4_t)a) > b; }
INLINE V where_above(V a, V b, V v) { return (V)((I)v & (a > b)); }
INLINE V whole(V x) { return (V)vrndnq_f32((float32x4_t)x); }
INLINE V reciprocal(V x) {
    float32x4_t a = (float32x4_t)x, y = vrecpeq_f32(a);
    y = vmulq_f32(y, vrecpsq_f32(a, y));
    return (V)vmulq_f32(y, vrecpsq_f32(a, y));
}
INLINE V twice_reciprocal_root(V x) { /* the step's own half is left out of the last one */
    float32x4_t a = (float32x4_t)x, y = vrsqrteq_f32(a);
    y = vmulq_f32(y, vrsqrtsq_f32(vmulq_f32(a, y), y));
    return (V)y * (3.0f - (x * (V)y) * (V)y);
}
#else
#define LANES for (int k = 0; k < WIDTH; k++)
INLINE V where_above(V a, V b, V v) { return (V)((I)v & (a > b)); }
INLINE V larger(V a, V b) { return (V)(((I)a & (a > b)) | ((I)b & ~(a > b))); }
INLINE int any_above(V a, float b) {
    int32_t any = 0;
    LANES any |= (a > b)[k];
    return any;
}
INLINE V whole(V x) { return __builtin_convertvector(__builtin_convertvector(x - 0.5f, I), V); }
INLINE V reciprocal(V x) { return 1.0f / x; }
INLINE V twice_reciprocal_root(V x) {
    LANES x[k] = sqrtf(x[k]);
    return 2.0f / x;
}
#endif

/* Relative error 1e-6 for 0 < x <= 1, of which a power x^n sees at most 4e-7 absolute, whatever n. */
INLINE V log2_of(V x) {
    I bits = (I)x, exponent = (bits - 0x3f3504f3) >> 23; /* mantissa within sqrt(1/2) and sqrt(2) */
    V t = (V)(bits - (exponent << 23)) - 1.0f, t2 = t * t;
    V high = (0.2948343644f - 0.2743090262f * t) + 0.1795841958f * t2;
    V middle = 0.4806657198f - 0.3586542032f * t;
    V low = 1.4426949041f - 0.7213887317f * t;
    return ((high * t2 + middle) * t2 + low) * t + __builtin_convertvector(exponent, V);
}

/* Relative error 8e-8. */
INLINE V exp2_of(V x) {
    V i = whole(x), f = x - i, f2 = f * f;
    V high = 0.009675541480f + 0.001327647203f * f;
    V middle = 0.2402211972f + 0.05550713275f * f;
    V low = 1.0000000717f + 0.6931469671f * f;
    V p = (high * f2 + middle) * f2 + low;
#if defined(__AVX512F__)
    return _mm512_scalef_ps(p, i);
#else
    return (V)((I)p + (__builtin_convertvector(i, I) << 23));
#endif
}

/* Planes are `stride` apart, aligned and padded to whole groups. */
struct scene {
    const float *points, *normals;
    const float *lights; /* rows of position and RGB intensity; none is zero */
    int64_t count, stride, light_count;
    float eye[3], ambient, ka[3], kd[3], ks[3], shininess, constants[3];
    int32_t coloured, attenuated, threads;
};

/* A light's constants: its position, those of f (over its intensity where it has one colour, twice
 * the root's half folded in), the least 1 / f, and the intensity. */
struct light {
    float at[3], c0, half_c1, c2, least, intensity[3];
};

struct pixels { /* position, normal, and half the direction to the eye mirrored at the normal */
    V x[UNROLL], y[UNROLL], z[UNROLL], nx[UNROLL], ny[UNROLL], nz[UNROLL];
    V wx[UNROLL], wy[UNROLL], wz[UNROLL];
};

struct terms { /* of one light; `free` is f where it is not held at most 1; root is twice 1 / d */
    V f[UNROLL], free[UNROLL], diffuse[UNROLL], lobe[UNROLL], log[UNROLL];
    V root[UNROLL], square[UNROLL];
};

enum { UNLIT, DULL, SHINY };

INLINE V load(const float *p) { return *(const V *)p; }
INLINE void store(float *p, V v) { *(V *)p = v; }

static void prepare(const struct scene *s, struct light *lights) {
    for (int64_t j = 0; j < s->light_count; j++) {
        const float *row = s->lights + 6 * j;
        float over = s->coloured ? 1.0f : 1.0f / row[3];
        for (int a = 0; a < 3; a++) {
            lights[j].at[a] = row[a];
            lights[j].intensity[a] = row[3 + a];
        }
        lights[j].c0 = over * s->constants[0];
        lights[j].half_c1 = over * 0.5f * s->constants[1];
        lights[j].c2 = over * s->constants[2];
        lights[j].least = over;
    }
}

INLINE void gather(const struct scene *s, int64_t i, struct pixels *p) {
    EACH {
        const float *point = s->points + i + u * WIDTH, *normal = s->normals + i + u * WIDTH;
        V x = load(point), y = load(point + s->stride), z = load(point + 2 * s->stride);
        V nx = load(normal), ny = load(normal + s->stride), nz = load(normal + 2 * s->stride);
        V vx = s->eye[0] - x, vy = s->eye[1] - y, vz = s->eye[2] - z;
        /* Half of v: the reciprocal root of the light's distance comes doubled. */
        V half = 0.25f * twice_reciprocal_root(vx * vx + vy * vy + vz * vz);
        V twice_n_dot_v = 2.0f * half * (nx * vx + ny * vy + nz * vz);
        p->x[u] = x, p->y[u] = y, p->z[u] = z, p->nx[u] = nx, p->ny[u] = ny, p->nz[u] = nz;
        p->wx[u] = twice_n_dot_v * nx - half * vx;
        p->wy[u] = twice_n_dot_v * ny - half * vy;
        p->wz[u] = twice_n_dot_v * nz - half * vz;
    }
}

INLINE int any_of_all(const V *v, float b) {
    V m = v[0];
    for (int u = 1; u < UNROLL; u++) m = larger(m, v[u]);
    return any_above(m, b);
}

/* f (times the light's one colour), twice max(0, n.l), and the lobe with its log2. Each loop is one
 * instruction or few, in turn over the vectors: that order is what hides their latency. */
INLINE int shade(const struct pixels *p, const struct light *l, float n, float floor,
                 const int attenuated, struct terms *t) {
    V dx[UNROLL], dy[UNROLL], dz[UNROLL], nd[UNROLL], wd[UNROLL], q[UNROLL];
    EACH dx[u] = l->at[0] - p->x[u];
    EACH dy[u] = l->at[1] - p->y[u];
    EACH dz[u] = l->at[2] - p->z[u];
    EACH nd[u] = p->nx[u] * dx[u] + p->ny[u] * dy[u] + p->nz[u] * dz[u];
    if (!DENSE && !any_of_all(nd, 0.0f)) return UNLIT;
    EACH t->square[u] = dx[u] * dx[u] + dy[u] * dy[u] + dz[u] * dz[u];
    EACH wd[u] = p->wx[u] * dx[u] + p->wy[u] * dy[u] + p->wz[u] * dz[u];
    EACH t->root[u] = twice_reciprocal_root(t->square[u]);
    EACH wd[u] *= t->root[u];
    if (attenuated) {
        EACH q[u] = l->c0 + t->square[u] * (l->half_c1 * t->root[u] + l->c2);
        EACH t->f[u] = reciprocal(larger(q[u], all(l->least)));
        EACH t->free[u] = where_above(q[u], all(l->least), t->f[u]);
    } else {
        EACH t->f[u] = all(1.0f / l->least);
    }
    EACH t->f[u] = where_above(nd[u], all(0.0f), t->f[u]);
    EACH t->diffuse[u] = nd[u] * t->root[u];
    if (!DENSE && !any_of_all(wd, floor)) return DULL;
    EACH t->log[u] = log2_of(larger(wd[u], all(floor)));
    EACH t->lobe[u] = exp2_of(n * t->log[u]);
    return SHINY;
}

INLINE void block_forward(const struct scene *s, const struct light *lights, int64_t start,
                          int64_t end, float *image, const int coloured, const int attenuated) {
    const float n = s->shininess, floor = exp2f(FAINT / n);
    const int channels = coloured ? 3 : 1;
    for (int64_t i = start; i < end; i += GROUP) {
        struct pixels p;
        V diffuse[3][UNROLL] = {0}, specular[3][UNROLL] = {0};
        gather(s, i, &p);
        for (int64_t j = 0; j < s->light_count; j++) {
            const struct light *l = lights + j;
            struct terms t;
            int kind = shade(&p, l, n, floor, attenuated, &t);
            if (kind == UNLIT) continue;
            if (coloured) EACH t.diffuse[u] *= t.f[u];
            for (int c = 0; c < channels; c++)
                EACH diffuse[c][u] += t.diffuse[u] * (coloured ? all(l->intensity[c]) : t.f[u]);
            if (kind == DULL) continue;
            if (coloured) EACH t.lobe[u] *= t.f[u];
            for (int c = 0; c < channels; c++)
                EACH specular[c][u] += t.lobe[u] * (coloured ? all(l->intensity[c]) : t.f[u]);
        }
        for (int c = 0; c < 3; c++) {
            int a = coloured ? c : 0;
            float ambient = s->ambient * s->ka[c], kd = 0.5f * s->kd[c], ks = s->ks[c];
            EACH store(image + c * s->stride + i + u * WIDTH,
                       ambient + kd * diffuse[a][u] + ks * specular[a][u]);
        }
    }
}

/* What the way back needs of a light that is not unlit. */
struct kept {
    V diffuse[UNROLL], specular[UNROLL], log[UNROLL], f[UNROLL], distance[UNROLL];
};

enum { LOSS, KA, KD = 4, KS = 7, N = 10, C0, C1, C2, SUMS };

/* Sums of e^2 and of e times the derivative of the image, e = image - target. */
INLINE void block_gradient(const struct scene *s, const struct light *lights, int64_t start,
                           int64_t end, const float *target, double *sums, struct kept *kept,
                           int *kinds, const int coloured, const int attenuated) {
    const float n = s->shininess, floor = exp2f(FAINT / n);
    const int channels = coloured ? 3 : 1;
    V total[SUMS] = {0};
    for (int64_t i = start; i < end; i += GROUP) {
        struct pixels p;
        V diffuse[3][UNROLL] = {0}, specular[3][UNROLL] = {0};
        gather(s, i, &p);
        for (int64_t j = 0; j < s->light_count; j++) {
            const struct light *l = lights + j;
            struct kept *k = kept + j;
            struct terms t;
            int kind = kinds[j] = shade(&p, l, n, floor, attenuated, &t);
            if (kind == UNLIT) continue;
            EACH k->diffuse[u] = t.diffuse[u] *= t.f[u];
            for (int c = 0; c < channels; c++)
                EACH diffuse[c][u] += coloured ? t.diffuse[u] * l->intensity[c] : t.diffuse[u];
            if (attenuated) {
                /* The derivative of f = 1 / q is -f^2, and none where f is held at most 1. */
                EACH k->f[u] = t.free[u] * l->least;
                EACH k->distance[u] = t.square[u] * t.root[u];
            }
            if (kind == DULL) continue;
            EACH k->log[u] = t.log[u];
            EACH k->specular[u] = t.lobe[u] *= t.f[u];
            for (int c = 0; c < channels; c++)
                EACH specular[c][u] += coloured ? t.lobe[u] * l->intensity[c] : t.lobe[u];
        }
        V by_kd[3][UNROLL] = {0}, by_ks[3][UNROLL] = {0};
        for (int c = 0; c < 3; c++) {
            int a = coloured ? c : 0;
            float ambient = s->ambient * s->ka[c], kd = 0.5f * s->kd[c], ks = s->ks[c];
            V e[UNROLL];
            EACH e[u] = ambient + kd * diffuse[a][u] + ks * specular[a][u] -
                        load(target + c * s->stride + i + u * WIDTH);
            if (i + GROUP > s->count) /* past the last pixel there is padding */
                for (int k = 0; k < GROUP; k++)
                    if (i + k >= s->count) e[k / WIDTH][k % WIDTH] = 0.0f;
            EACH total[LOSS] += e[u] * e[u];
            EACH total[KA + c] += e[u];
            EACH total[KD + c] += e[u] * diffuse[a][u];
            EACH total[KS + c] += e[u] * specular[a][u];
            EACH by_kd[a][u] += kd * e[u];
            EACH by_ks[a][u] += ks * e[u];
        }
        for (int64_t j = 0; j < s->light_count; j++) {
            const struct light *l = lights + j;
            const struct kept *k = kept + j;
            const float *b = l->intensity;
            if (kinds[j] == UNLIT || (kinds[j] == DULL && !attenuated)) continue;
            V g[UNROLL];
            EACH g[u] = k->diffuse[u] * (coloured ? b[0] * by_kd[0][u] + b[1] * by_kd[1][u] +
                                                        b[2] * by_kd[2][u]
                                                  : by_kd[0][u]);
            if (kinds[j] == SHINY) {
                V h[UNROLL];
                EACH h[u] = k->specular[u] * (coloured ? b[0] * by_ks[0][u] + b[1] * by_ks[1][u] +
                                                             b[2] * by_ks[2][u]
                                                       : by_ks[0][u]);
                EACH total[N] += h[u] * k->log[u];
                EACH g[u] += h[u];
            }
            if (!attenuated) continue;
            EACH g[u] *= k->f[u];
            EACH total[C0] += g[u];
            EACH g[u] *= k->distance[u];
            EACH total[C1] += g[u];
            EACH total[C2] += g[u] * k->distance[u];
        }
    }
    for (int a = 0; a < SUMS; a++)
        for (int k = 0; k < WIDTH; k++) sums[a] += total[a][k];
}

/* Specialised for lights of one colour and for lights without attenuation. */
#define SPECIALISED(function, ...)                                \
    do {                                                          \
        if (s->coloured && s->attenuated) function(__VA_ARGS__, 1, 1); \
        else if (s->coloured) function(__VA_ARGS__, 1, 0);        \
        else if (s->attenuated) function(__VA_ARGS__, 0, 1);      \
        else function(__VA_ARGS__, 0, 0);                         \
    } while (0)
#define END(start) (start + BLOCK < s->count ? start + BLOCK : s->count)

/* The image's planes. */
void forward(const struct scene *s, float *image) {
    struct light lights[s->light_count + 1];
    prepare(s, lights);
#pragma omp parallel for schedule(dynamic) num_threads(s->threads)
    for (int64_t start = 0; start < s->count; start += BLOCK)
        SPECIALISED(block_forward, s, lights, start, END(start), image);
}

/* The mean squared error, and its derivatives in ka, kd, ks, n and the constants of attenuation. */
void gradient(const struct scene *s, const float *target, double *out) {
    struct light lights[s->light_count + 1];
    double sums[SUMS] = {0};
    prepare(s, lights);
#pragma omp parallel num_threads(s->threads)
    {
        struct kept kept[s->light_count + 1];
        int kinds[s->light_count + 1];
        double own[SUMS] = {0};
#pragma omp for schedule(dynamic)
        for (int64_t start = 0; start < s->count; start += BLOCK)
            SPECIALISED(block_gradient, s, lights, start, END(start), target, own, kept, kinds);
#pragma omp critical
        for (int a = 0; a < SUMS; a++) sums[a] += own[a];
    }
    /* Sums were of twice n.l, of log2, and of twice the distance. */
    double scale[SUMS] = {1, 2, 2, 2, 1, 1, 1, 2, 2, 2, 2 * M_LN2, -2, -1, -0.5};
    for (int c = 0; c < 3; c++) scale[KA + c] *= s->ambient;
    for (int a = 0; a < SUMS; a++) out[a] = sums[a] * scale[a] / (3.0 * (double)s->count);
}
