// SPDX-License-Identifier: Apache-2.0
// ServeOptions has the options --serve [PORT] and --serve-host of `ubs train`, which show training in a
// browser (docs/web.md).
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "host/look/serve/server.hpp"

namespace ubs::tools {

class ServeOptions {
 public:
  explicit ServeOptions(CLI::App& app);
  ServeOptions(const ServeOptions&) = delete;

  CLI::Option& option() const { return *option_; }
  // Opens the port and prints the address. Returns null if --serve was not given.
  std::unique_ptr<serve::Server> open() const;

 private:
  serve::Address address_;
  CLI::Option* option_;
};

}  // namespace ubs::tools
