// SPDX-License-Identifier: Apache-2.0
#include "host/base/error.hpp"

namespace ubs {

int exit_code(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::usage:
      return 2;
    case ErrorKind::data:
      return 3;
    case ErrorKind::device:
      return 4;
    case ErrorKind::build:
      return 5;
    case ErrorKind::memory:
      return 6;
    case ErrorKind::numerical:
      return 7;
    case ErrorKind::faulty:
      return 10;
    case ErrorKind::internal:
      return 1;
  }
  return 1;
}

}  // namespace ubs
