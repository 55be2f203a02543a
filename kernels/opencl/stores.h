// SPDX-License-Identifier: Apache-2.0
// stores.h replaces the functions vstore8 and vstore16 of PoCL, which split the vector into stores of 16 bytes. For a
// float16, PoCL needs seven instructions instead of one. In addition, a load of the whole vector soon afterwards has to
// wait until all four parts are in the cache.
#ifdef UBS_POCL
#define UBS_DEFINE_VSTORE(space, type, width)                                           \
  static inline __attribute__((overloadable, always_inline)) void ubs_vstore##width(    \
      type##width value, size_t offset, space type* pointer) {                          \
    typedef type##width unaligned __attribute__((aligned(sizeof(type))));               \
    *(space unaligned*)(pointer + width * offset) = value;                              \
  }
#define UBS_DEFINE_VSTORES(type, width)      \
  UBS_DEFINE_VSTORE(__global, type, width)   \
  UBS_DEFINE_VSTORE(__local, type, width)    \
  UBS_DEFINE_VSTORE(__private, type, width)
UBS_DEFINE_VSTORES(float, 8)
UBS_DEFINE_VSTORES(float, 16)
UBS_DEFINE_VSTORES(uint, 8)
UBS_DEFINE_VSTORES(uint, 16)
UBS_DEFINE_VSTORES(ushort, 8)
UBS_DEFINE_VSTORES(ushort, 16)
#ifdef UBS_REAL_DOUBLE
UBS_DEFINE_VSTORES(double, 8)
UBS_DEFINE_VSTORES(double, 16)
#endif
#undef vstore8
#undef vstore16
#define vstore8 ubs_vstore8
#define vstore16 ubs_vstore16
#endif
