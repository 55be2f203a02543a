// SPDX-License-Identifier: Apache-2.0
#include "tools/common/serve_options.hpp"

#include "tools/common/number_check.hpp"
#include "tools/common/streams.hpp"

namespace ubs::tools {

ServeOptions::ServeOptions(CLI::App& app) {
  option_ = app.add_option("--serve", address_.port,
                           "show training in a browser at this port, 8080 if none is given; 0: any free "
                           "port (docs/web.md)")
                ->expected(0, 1)
                ->default_str(std::to_string(address_.port))
                ->check(from_to(0, 65535))
                ->type_name("[PORT]");
  app.add_option(
         "--serve-host", address_.host,
         "address to listen on [127.0.0.1]; requests from other machines need the token that is printed")
      ->needs(option_)
      ->type_name("HOST");
}

std::unique_ptr<serve::Server> ServeOptions::open() const {
  if (option_->count() == 0) return nullptr;
  auto server = std::make_unique<serve::Server>(address_);
  remark("ubs: live at {}\n", server->url());
  return server;
}

}  // namespace ubs::tools
