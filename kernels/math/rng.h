// SPDX-License-Identifier: Apache-2.0
// rng.h contains the random number generator Philox4x32-10 (Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as
// easy as 1, 2, 3", SC 2011). Its random words are a pure function of (seed, iteration, purpose, index). It has no
// state, so that any number of threads and any device produce the same random numbers. The lanes of a vector have
// different indices.
#pragma once

#if defined(UBS_OPENCL)
#define ubs_mul_hi(a, b) mul_hi(a, b)
#elif defined(UBS_HOST)
#define ubs_mul_hi(a, b) ((unsigned int)(((unsigned long long)(a) * (b)) >> 32))
#else
#define ubs_mul_hi(a, b) __umulhi(a, b)
#endif

#define UBS_TWO_PI R(6.28318530717958647692)

typedef struct {
  vuint x, y, z, w;
} RandomWords;

UBS_FN RandomWords philox4x32_10(RandomWords c, unsigned int key0, unsigned int key1) {
  vuint multiplier0 = (vuint)(0xD2511F53u), multiplier1 = (vuint)(0xCD9E8D57u);
  for (int round = 0; round < 10; ++round) {
    RandomWords next;
    next.x = ubs_mul_hi(multiplier1, c.z) ^ c.y ^ (vuint)(key0);
    next.y = multiplier1 * c.z;
    next.z = ubs_mul_hi(multiplier0, c.x) ^ c.w ^ (vuint)(key1);
    next.w = multiplier0 * c.x;
    c = next;
    key0 += 0x9E3779B9u;  // golden ratio
    key1 += 0xBB67AE85u;  // sqrt(3) - 1
  }
  return c;
}

// Returns four random words. `seed` and `iteration` are passed as two words each, the low word first.
UBS_FN RandomWords random_words(unsigned int seed0, unsigned int seed1, unsigned int iteration0,
                                unsigned int iteration1, unsigned int purpose, vuint index) {
  RandomWords counter;
  counter.x = index;
  counter.y = (vuint)(iteration0);
  counter.z = (vuint)(iteration1);
  counter.w = (vuint)(purpose);
  return philox4x32_10(counter, seed0, seed1);
}

// Returns a number between 0 and 1. It is never 0. In single precision, the largest words give 1, which is allowed in
// random_normals().
UBS_FN vreal random_uniform(vuint word) {
  return (UBS_TO_VREAL(word) + V(0.5)) * R(2.3283064365386962890625e-10);  // 2^-32
}

typedef struct {
  vreal x, y, z, w;
} RandomNormals;

// Returns four independent standard normals, computed from four words by the method of Box and Muller. No result
// exceeds 6.77 in magnitude, because the smallest uniform number is 2^-33.
UBS_FN RandomNormals random_normals(RandomWords words) {
  vreal radius0 = ubs_sqrt(V(-2.0) * ubs_log(random_uniform(words.x)));
  vreal radius1 = ubs_sqrt(V(-2.0) * ubs_log(random_uniform(words.z)));
  vreal angle0 = UBS_TWO_PI * random_uniform(words.y);
  vreal angle1 = UBS_TWO_PI * random_uniform(words.w);
  RandomNormals n;
  n.x = radius0 * ubs_cos(angle0);
  n.y = radius0 * ubs_sin(angle0);
  n.z = radius1 * ubs_cos(angle1);
  n.w = radius1 * ubs_sin(angle1);
  return n;
}
