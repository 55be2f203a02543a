// SPDX-License-Identifier: Apache-2.0
// elementary.h defines exponentials, logarithms, softplus and sigmoid of vreal. They are accurate even where the plain
// formulas would suffer from cancellation. For float vectors with several lanes, which are used on CPUs, the functions
// are polynomials defined here. The reason is that PoCL splits log, log2 and pow into scalar calls, which is 17 times
// slower with 16 lanes, and that its exp is slower as well. In all other cases, the functions call those of the
// library.
#pragma once

#if defined(UBS_OPENCL) && !defined(UBS_REAL_DOUBLE) && UBS_VW > 1
#define UBS_POLYNOMIAL_LOG 1
#endif

#ifndef UBS_MATH  // the math mode (MathMode in host/scene/math_mode.hpp): 0 exact, 1 native, 2 rough
#define UBS_MATH 0
#endif

// Several holds several independent values. Functions process the first `count` values together, step by step, so that
// an instruction for one value need not wait for an instruction for another value. `count` is a constant.
typedef struct {
  vreal e[12];
} Several;

#define UBS_EACH(k, count) UBS_UNROLL for (int k = 0; k < 12; ++k) if (k < (count))

#define UBS_LN2 R(0.69314718055994530942)
#define UBS_LOG2E R(1.44269504088896340736)

// The largest number below 1.
#ifdef UBS_REAL_DOUBLE
#define UBS_BELOW_ONE R(0.99999999999999989)
#else
#define UBS_BELOW_ONE R(0.99999994)
#endif

#ifdef UBS_POLYNOMIAL_LOG
#define UBS_AS_VMASK UBS_PASTE(as_int, UBS_VW)
#define UBS_AS_VREAL UBS_PASTE(as_float, UBS_VW)

// Returns log2(1+t)/t for t in [sqrt(1/2)-1, sqrt(2)-1], computed with a minimax polynomial. The polynomial itself has
// a relative error of 2.6e-8, which is below half an ulp. Here and in ubs_exp2(), the polynomial is evaluated with
// Estrin's scheme, so that the longest chain has 4 products. With Horner's scheme it would have 8, which makes the
// backward rasteriser 13 % slower. With rounding, the relative error is 3.2e-7 (Horner's scheme: 2.7e-7).
UBS_FN vreal ubs_log2_poly(vreal t) {
  vreal t2 = t * t;
#if UBS_MATH == 1  // relative error 7.4e-6
  vreal p01 = fma(V(-0.7212063670158386), t, V(1.4427015781402588));
  vreal p23 = fma(V(-0.3664917051792145), t, V(0.4798118472099304));
  vreal p45 = fma(V(-0.2061910033226013), t, V(0.3181999027729034));
  return fma(fma(p45, t2, p23), t2, p01);
#elif UBS_MATH == 2  // relative error 3.5e-4
  vreal p01 = fma(V(-0.7242969870567322), t, V(1.4422703981399536));
  return fma(fma(V(-0.3277706801891327), t, V(0.5112727284431458)), t2, p01);
#else
  vreal t4 = t2 * t2;
  vreal p01 = fma(V(-0.7213473320007324), t, V(1.4426950216293335));
  vreal p23 = fma(V(-0.3607036769390106), t, V(0.48091062903404236));
  vreal p45 = fma(V(-0.23894482851028442), t, V(0.28791624307632446));
  vreal p67 = fma(V(-0.20726974308490753), t, V(0.21571560204029083));
  vreal low = fma(p23, t2, p01);
  vreal high = fma(V(0.12583701312541962), t4, fma(p67, t2, p45));
  return fma(high, t4, low);
#endif
}

// Returns log2(x). x must be a positive normal number. It is split into x = 2^e m with m in [sqrt(1/2), sqrt(2)).
UBS_FN vreal ubs_log2(vreal x) {
  vmask bits = UBS_AS_VMASK(x);
  vmask e = (bits - 0x3f3504f3) >> 23;
  vreal t = UBS_AS_VREAL(bits - (e << 23)) - V(1.0);
  return fma(ubs_log2_poly(t), t, UBS_TO_VREAL(e));
}

// Returns log2(1 - r) for 0 <= r < 1. If the exponent e is 0, t is set to exactly -r, so that no digits of a small r
// are lost by the subtraction 1 - r. This makes the error of the beta gradient 116 times smaller.
UBS_FN vreal ubs_log2_1m(vreal r) {
  vreal x = V(1.0) - r;
  vmask bits = UBS_AS_VMASK(x);
  vmask e = (bits - 0x3f3504f3) >> 23;
  vreal t = e == 0 ? -r : UBS_AS_VREAL(bits - (e << 23)) - V(1.0);
  return fma(ubs_log2_poly(t), t, UBS_TO_VREAL(e));
}

// Returns 2^y for -126 <= y < 127. If y is below -126, the result is 2^-126, so that there are no denormals and no
// zeros. The polynomial has a relative error of 9.2e-8 on [-1/2, 1/2]. The addition of 1.5 * 2^23 rounds y to an
// integer, which is then in the low bits of the sum. Shifting these bits into the exponent removes the other bits.
UBS_FN vreal ubs_exp2(vreal y) {
  y = y < V(-126.0) ? V(-126.0) : y;
  vreal shifted = y + V(12582912.0);
  vmask shifted_bits = UBS_AS_VMASK(shifted);
  vreal f = y - (shifted - V(12582912.0));
  vreal f2 = f * f;
#if UBS_MATH == 1  // relative error 2.8e-6
  vreal p01 = fma(V(0.6931241750717163), f, V(1.0));
  vreal p23 = fma(V(0.0559064261615276), f, V(0.2402409911155701));
  vreal p = fma(fma(V(0.0095828529447317), f2, p23), f2, p01);
#elif UBS_MATH == 2  // relative error 1.0e-4
  vreal p =
      fma(fma(V(0.0550089292228222), f, V(0.2422109544277191)), f2, fma(V(0.6932829022407532), f, V(1.0)));
#else
  vreal p01 = fma(V(0.6931470036506653), f, V(1.0));
  vreal p23 = fma(V(0.05550733581185341), f, V(0.24022242426872253));
  vreal p45 = fma(V(0.001326472731307149), f, V(0.009671512991189957));
  vreal p = fma(fma(p45, f2, p23), f2, p01);
#endif
  return UBS_AS_VREAL(UBS_AS_VMASK(p) + (shifted_bits << 23));
}

UBS_FN vreal ubs_log(vreal x) { return ubs_log2(x) * UBS_LN2; }

// Each of the next two functions is a chain of about thirty dependent instructions, and a processor can only reorder
// about a hundred waiting instructions. Therefore each loop advances all values by one step before the next loop
// starts.

// Returns log(1 + x) for 0 <= x <= 1, with a relative error of 2.6e-7. Kahan's correction restores the digits that are
// lost by the addition 1 + x.
UBS_FN Several log1p_several(Several x, int count) {
  Several t, log2;
  UBS_EACH(k, count) {
    vreal u = V(1.0) + x.e[k];
    vmask halved = UBS_AS_VMASK(u) >= 0x3fb504f3;  // u >= sqrt(2)
    t.e[k] = (halved ? V(0.5) * u : u) - V(1.0);
    log2.e[k] = halved ? V(1.0) : V(0.0);
    x.e[k] = (x.e[k] - (u - V(1.0))) / u;
  }
  UBS_EACH(k, count) log2.e[k] = fma(ubs_log2_poly(t.e[k]), t.e[k], log2.e[k]);
  UBS_EACH(k, count) log2.e[k] = log2.e[k] * UBS_LN2;
  UBS_EACH(k, count) log2.e[k] += x.e[k];
  return log2;
}

// Returns exp(x) for x <= 88.37, with a relative error of 8.2e-8. x is split into n ln 2 + r, where ln 2 is the sum of
// two floats. For x below -87.33, where denormals begin, the result is 0. If x is a NaN that results from arithmetic,
// the result is NaN.
UBS_FN Several exp_several(Several x, int count) {
  Several shifted, r, p;
  UBS_EACH(k, count) shifted.e[k] = fma(x.e[k], (vreal)(UBS_LOG2E), V(12582912.0));
  UBS_EACH(k, count) {
    vreal n = shifted.e[k] - V(12582912.0);
    r.e[k] = fma(n, V(-1.428606765330187e-06), fma(n, V(-0.693145751953125), x.e[k]));
  }
  UBS_EACH(k, count) {
    vreal p23 = fma(r.e[k], V(0.0083334519073), V(0.041665795894));
    vreal p45 = fma(r.e[k], V(0.00019875691500), V(0.0013981999507));
    p.e[k] = fma(p45, r.e[k] * r.e[k], p23);
  }
  UBS_EACH(k, count) {
    vreal r2 = r.e[k] * r.e[k], p01 = fma(r.e[k], V(0.16666665459), V(0.50000001201));
    p.e[k] = fma(fma(p.e[k], r2, p01), r2, r.e[k]) + V(1.0);
  }
  UBS_EACH(k, count) {
    p.e[k] = UBS_AS_VREAL(UBS_AS_VMASK(p.e[k]) + (UBS_AS_VMASK(shifted.e[k]) << 23));
    p.e[k] = x.e[k] < V(-87.33) ? V(0.0) : p.e[k];
  }
  return p;
}

UBS_FN vreal ubs_log1p(vreal x) {
  Several one;
  one.e[0] = x;
  return log1p_several(one, 1).e[0];
}

// Returns exp(x). x must be at most 88.37.
UBS_FN vreal exp_nonpositive(vreal x) {
  Several one;
  one.e[0] = x;
  return exp_several(one, 1).e[0];
}

// Returns exp(x). For x above 88.37 the result is infinite, although exp(x) exceeds the range of floats only from 88.72
// on. For NaN it is NaN.
UBS_FN vreal ubs_exp(vreal x) { return x <= V(88.37) ? exp_nonpositive(x) : x * (vreal)(INFINITY); }

#elif defined(UBS_HOST)
#define ubs_log(x) ::log(x)
#define ubs_log1p(x) ::log1p(x)
#define ubs_log2_1m(r) (::log1p(-(r)) * UBS_LOG2E)
#define ubs_exp2(y) ::exp2(y)
#define ubs_reciprocal(x) (V(1.0) / (x))
#elif defined(UBS_REAL_DOUBLE)  // OpenCL
#define ubs_exp(x) exp(x)
#define ubs_log(x) log(x)
#define ubs_log1p(x) log1p(x)
#define ubs_log2_1m(r) (log1p(-(r)) * UBS_LOG2E)
#define ubs_exp2(y) exp2(y)
#define ubs_reciprocal(x) (V(1.0) / (x))
#else
// This part is for single floats, which are used on GPUs with OpenCL and CUDA. On GPUs the native functions are single
// instructions. According to the specification of PTX, native_exp2 and native_log2 have relative errors of at most
// 2^-22, except that the error of native_log2 near 1 is absolute. The relative error of native_recip is at most 2^-23;
// on AMD its error is at most 1 ulp. OpenCL leaves the accuracy to the device, and ubs checks the device before its
// first use. On CPUs the host replaces the native functions by exp2 and log2.
#ifdef UBS_OPENCL
#define ubs_exp(x) exp(x)
#define ubs_log(x) log(x)
#define ubs_log1p(x) log1p(x)
#else
#define ubs_log(x) logf(x)
#define ubs_log1p(x) log1pf(x)
#endif
#define ubs_exp2(y) native_exp2(y)  // same result as exp2, which scales its argument only for denormals
#if UBS_MATH
#define ubs_log2_1m(r) native_log2(R(1.0) - (r))
#else
// Returns log2(1 - r) for 0 <= r < 1. For small r, native_log2 has two disadvantages: its absolute error is large
// compared with the result, and the subtraction 1 - r loses the low bits of r. Therefore, for r < 1/4, the result is
// computed with a minimax polynomial, which has a relative error of 1.5e-7. The largest relative error is 7.5e-7, at
// r = 1/4. (log1pf has an error of 1.3e-7, but takes 27 instructions instead of 10.)
UBS_FN vreal ubs_log2_1m(vreal r) {
  vreal p = ubs_fma(V(-0.49022483825683594), r, V(-0.20762518048286438));
  p = ubs_fma(p, r, V(-0.37192603945732117));
  p = ubs_fma(p, r, V(-0.48021063208580017));
  p = ubs_fma(p, r, V(-0.7213626503944397));
  p = ubs_fma(p, r, V(-1.4426950216293335));
  return r < V(0.25) ? p * r : native_log2(V(1.0) - r);
}
#endif
// Returns 1 / x. Neither x nor the result may be near overflow or denormal. The ordinary division of floats contains a
// branch for such numbers, which is not needed here.
UBS_FN vreal ubs_reciprocal(vreal x) {
  vreal y = native_recip(x);
  return ubs_fma(y, ubs_fma(-x, y, V(1.0)), y);
}
#endif
#ifdef UBS_POLYNOMIAL_LOG
#define ubs_reciprocal(x) (V(1.0) / (x))
#else
#define exp_nonpositive(x) ubs_exp(x)
UBS_FN Several exp_several(Several x, int count) {
  UBS_EACH(k, count) x.e[k] = ubs_exp(x.e[k]);
  return x;
}
UBS_FN Several log1p_several(Several x, int count) {
  UBS_EACH(k, count) x.e[k] = ubs_log1p(x.e[k]);
  return x;
}
#endif

// Returns 1 / (1 + exp(-x)), without overflow for any x.
UBS_FN vreal ubs_sigmoid(vreal x) {
  vreal e = exp_nonpositive(-ubs_fabs(x));
  return (x < V(0.0) ? e : V(1.0)) / (V(1.0) + e);
}

// Returns softplus(x) = log(1 + exp(x)), computed as max(x, 0) + log1p(exp(-|x|)). The derivative of softplus is the
// sigmoid. For x above 20 the result is x in single precision, which is also the value that PyTorch returns.
UBS_FN Several softplus_several(Several x, int count) {
  Several y;
  UBS_EACH(k, count) y.e[k] = -ubs_fabs(x.e[k]);
  y = log1p_several(exp_several(y, count), count);
  UBS_EACH(k, count) y.e[k] = (x.e[k] < V(0.0) ? V(0.0) : x.e[k]) + y.e[k];
  return y;
}

UBS_FN vreal ubs_softplus(vreal x) {
  Several one;
  one.e[0] = x;
  return softplus_several(one, 1).e[0];
}
