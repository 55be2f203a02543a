// SPDX-License-Identifier: Apache-2.0
// MemoryKind says where memory is, for programs that share it: the library passes it to other packages, and
// MPI libraries can send some kinds. The values are the numbers of DLDeviceType in DLPack's dlpack.h; a back
// end with another kind adds its number.
#pragma once

namespace ubs {

enum class MemoryKind { host = 1, cuda = 2 };

}  // namespace ubs
