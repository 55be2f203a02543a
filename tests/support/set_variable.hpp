// SPDX-License-Identifier: Apache-2.0
// Variable sets an environment variable, and restores the previous value when the object is destroyed.
#pragma once

#include <cstdlib>
#include <string>

namespace ubs::test {

class Variable {
 public:
  // If `value` is null, the variable is unset.
  Variable(const char* name, const char* value) : name_(name) {
    if (const char* old = std::getenv(name)) old_ = old, had_ = true;
    value ? setenv(name, value, 1) : unsetenv(name);
  }
  ~Variable() { had_ ? setenv(name_, old_.c_str(), 1) : unsetenv(name_); }
  Variable(const Variable&) = delete;

 private:
  const char* name_;
  std::string old_;
  bool had_ = false;
};

}  // namespace ubs::test
