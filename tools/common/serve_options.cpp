// SPDX-License-Identifier: Apache-2.0
#include "tools/common/serve_options.hpp"

#include <fmt/format.h>

#include <charconv>

#include "tools/common/streams.hpp"

namespace ubs::tools {

namespace {

// Of --serve without a value it stays what it is.
bool read_port(const std::string& text, int& port) {
  if (text.empty()) return true;
  const char* end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, port);
  return error == std::errc() && rest == end && port >= 0 && port <= 65535;
}

}  // namespace

ServeOptions::ServeOptions(CLI::App& app) {
  option_ =
      app.add_option("--serve", port_,
                     "show it in a browser, at this port of this machine; 0: a free one (docs/web.md) [8080]")
          ->expected(0, 1)
          ->check(CLI::Validator(
              [](const std::string& text) -> std::string {
                int port = 0;
                if (read_port(text, port)) return {};
                return fmt::format("{} is no port (0 to 65535); data and models stand before it", text);
              },
              ""))
          ->type_name("[PORT]");
  app.add_option("--serve-host", host_,
                 "address to serve at; beyond this machine pages need the token that is printed [127.0.0.1]")
      ->needs(option_)
      ->type_name("HOST");
}

std::unique_ptr<serve::Server> ServeOptions::open() const {
  if (option_->count() == 0) return nullptr;
  serve::Address address{.host = host_};
  read_port(port_, address.port);
  auto server = std::make_unique<serve::Server>(address);
  remark("ubs: live at {}\n", server->url());
  return server;
}

}  // namespace ubs::tools
