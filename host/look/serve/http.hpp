// SPDX-License-Identifier: Apache-2.0
// Http reads one HTTP request from a connected socket, checks that the sender is allowed to send it, and
// answers it. The library cpp-httplib parses requests and writes answers. Http adds limits that the library
// does not have: on the bytes and the time of a request, and on the time of an answer. No exception leaves
// answer(). One connection carries one request, so a client can neither send further requests after the first
// one nor hide one in its body.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace ubs::serve {

struct HttpReply {
  int status = 200;
  std::string type = "text/plain", body;
  std::vector<std::pair<std::string, std::string>> headers;
};

// Site contains the content that is served, and the conditions for access.
struct Site {
  std::string host;                    // name or address that the server was told to listen on
  bool loopback = true;                // only programs on this machine can connect
  std::string token;                   // must be in the address of requests; empty: no token is needed
  std::string page;                    // HTML page, the answer to GET /
  std::function<std::string()> state;  // returns the answer to GET /state as JSON
  // Answers POST /picture; receives the body of the request. `gone` returns true if the sender has closed the
  // connection.
  std::function<HttpReply(const std::string& body, const std::function<bool()>& gone)> picture;
};

class Http {
 public:
  explicit Http(Site site);
  ~Http();

  // Answers one request. Calls `admitted` when the request has arrived completely, with its body, and is
  // allowed. Leaves the socket open. May be called from several threads at once.
  void answer(int socket, const std::function<void()>& admitted) noexcept;

 private:
  class Library;
  std::unique_ptr<Library> library_;
};

}  // namespace ubs::serve
