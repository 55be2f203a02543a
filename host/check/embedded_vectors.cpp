// SPDX-License-Identifier: Apache-2.0
// During the build, ubs_check_vectors writes the expected results of the device check to a file. This source
// embeds that file in the program. UBS_CHECK_VECTORS is the path of that file.
#include "host/check/vectors.hpp"

#ifdef _WIN32
#define UBS_READ_ONLY ".section .rdata,\"dr\"\n"
#else  // without .hidden, the shared library would export these symbols, as it exports all names ubs_*
#define UBS_READ_ONLY \
  ".hidden ubs_check_vectors_begin\n.hidden ubs_check_vectors_end\n.section .rodata,\"a\"\n"
#endif
__asm__(UBS_READ_ONLY
        ".global ubs_check_vectors_begin\n"
        ".global ubs_check_vectors_end\n"
        ".balign 16\n"
        "ubs_check_vectors_begin:\n"
        ".incbin \"" UBS_CHECK_VECTORS
        "\"\n"
        "ubs_check_vectors_end:\n"
        ".byte 0\n"
        ".text\n");

extern "C" {
extern const unsigned char ubs_check_vectors_begin[], ubs_check_vectors_end[];
}

namespace ubs::check {

const Vectors& embedded_vectors() {
  static const Vectors vectors =
      unpack(std::as_bytes(std::span(ubs_check_vectors_begin, ubs_check_vectors_end)));
  return vectors;
}

}  // namespace ubs::check
