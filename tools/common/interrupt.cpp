// SPDX-License-Identifier: Apache-2.0
#include "tools/common/interrupt.hpp"

namespace ubs::tools {
namespace {

volatile std::sig_atomic_t received = 0;

void note(int) { received = 1; }

}  // namespace

InterruptGuard::InterruptGuard() {
  received = 0;
  struct sigaction action = {};
  action.sa_handler = note;
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, &previous_int_);
  sigaction(SIGTERM, &action, &previous_term_);
}

InterruptGuard::~InterruptGuard() {
  sigaction(SIGINT, &previous_int_, nullptr);
  sigaction(SIGTERM, &previous_term_, nullptr);
}

bool InterruptGuard::interrupted() const { return received != 0; }

}  // namespace ubs::tools
