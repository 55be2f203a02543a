// SPDX-License-Identifier: Apache-2.0
// slot_pieces.h defines macros for kernels that access the gradient slots. Normally the slots are in one buffer. If
// they do not fit into a single allocation of the device, the host defines UBS_SLOT_PIECES, and the slots are in up to
// eight buffers of 2^slot_bits slots each. No slot is split between two buffers. Kernels and functions declare the
// buffers as parameters with UBS_SLOTS and pass them on with UBS_SLOT_ARGUMENTS. UBS_SLOT_PIECE(slot) is the buffer
// that contains a slot, and UBS_SLOT_IN_PIECE(slot) is the index of the slot in this buffer. CUDA always has one
// buffer.
#pragma once

#ifndef UBS_OPENCL
#define UBS_SLOTS(type) type slots
#define UBS_SLOT_ARGUMENTS slots
#define UBS_SLOT_IN_PIECE(slot) (slot)
#define UBS_SLOT_PIECE(slot) slots
#else
#define UBS_SLOTS(type)                                                                                   \
  type slots0, type slots1, type slots2, type slots3, type slots4, type slots5, type slots6, type slots7, \
      uint slot_bits
#define UBS_SLOT_ARGUMENTS slots0, slots1, slots2, slots3, slots4, slots5, slots6, slots7, slot_bits
#ifdef UBS_SLOT_PIECES
#define UBS_SLOT_IN_PIECE(slot) ((slot) & ((1u << slot_bits) - 1u))
#define UBS_SLOT_PIECE(slot)                                                                                  \
  (((slot) >> slot_bits) < 4                                                                                  \
       ? ((slot) >> slot_bits) < 2 ? ((slot) >> slot_bits) == 0 ? slots0 : slots1                             \
                                   : ((slot) >> slot_bits) == 2 ? slots2 : slots3                             \
       : ((slot) >> slot_bits) < 6 ? ((slot) >> slot_bits) == 4 ? slots4 : slots5                             \
                                   : ((slot) >> slot_bits) == 6 ? slots6 : slots7)
#else
#define UBS_SLOT_IN_PIECE(slot) (slot)
#define UBS_SLOT_PIECE(slot) slots0
#endif
#endif
