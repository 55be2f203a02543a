// SPDX-License-Identifier: Apache-2.0
// Numbers of elements of list kernels: known to the host and passed by value, or, with UBS_BOUNDED, counted on the
// device and read from a buffer of one, so that the host need not wait for them. The launch then has work-items for
// what the buffers have room for, of which those beyond the number have nothing to do.
#pragma once

#ifdef UBS_BOUNDED
#define UBS_AMOUNT(name) __global const uint* restrict name##_counted
#define UBS_TAKE_AMOUNT(name) const uint name = *name##_counted;
// The chunks of a launch share what there is, in whole cache lines.
#define UBS_TAKE_CHUNKS(name, chunk) \
  UBS_TAKE_AMOUNT(name)              \
  chunk = (uint)(max((size_t)1, (name + get_global_size(0) - 1) / get_global_size(0)) + 15) & ~15u;
#else
#define UBS_AMOUNT(name) uint name
#define UBS_TAKE_AMOUNT(name)
#define UBS_TAKE_CHUNKS(name, chunk)
#endif
