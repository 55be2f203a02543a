// SPDX-License-Identifier: Apache-2.0
// Tests the server of `ubs view` and `ubs train --serve` without training or rendering. Invalid requests,
// slow clients and errors must not affect other clients.
#include "host/look/serve/server.hpp"

#include <fcntl.h>
#include <sys/resource.h>

#include <catch2/catch.hpp>
#include <future>
#include <new>
#include <optional>
#include <thread>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "tests/web/http_client.hpp"

namespace ubs::serve {
namespace {

using namespace std::chrono_literals;

constexpr double kPrompt = 60;  // [s]; if closing waited for clients, it would take longer

Picture no_picture(const PictureRequest&) {
  return {.bytes = "picture", .headers = {{"Ubs-Iteration", "7"}}};
}

// Sends a request for an image, and renders until it is answered.
Answer picture(Server& server, const std::string& body, const Server::Draw& draw = no_picture) {
  auto answer = std::async(std::launch::async, [&] { return answer_of(server, post(body)); });
  while (answer.wait_for(0s) != std::future_status::ready) server.serve(10ms, draw);
  return answer.get();
}

struct Started : Server {
  explicit Started(const std::string& host = "127.0.0.1") : Server({host, 0}) { start("<p>page</p>"); }
};

bool one_line(const std::string& text) {
  return text.size() > 5 && text.size() <= 301 && text.find('\n') == text.size() - 1;
}

TEST_CASE("the server answers with the image and its headers, with the state, and with the page") {
  Started server;
  const Answer answer = picture(server, request_json().dump());
  CHECK(answer.status == 200);
  CHECK(answer.body == "picture");
  CHECK(answer.head.find("\r\nUbs-Iteration: 7\r\n") != std::string::npos);
  CHECK(answer.head.find("\r\nContent-Type: image/jpeg") != std::string::npos);
  CHECK(answer.head.find("\r\nCache-Control: no-store") != std::string::npos);
  server.publish("{\"a\": 1}");
  CHECK(answer_of(server, get("/state")).body == "{\"a\": 1}");
  CHECK(answer_of(server, get("/")).body == "<p>page</p>");
}

TEST_CASE("an exception of any type while an image is rendered gives status 500, and the server continues") {
  Started server;
  const auto thrown = [&](const Server::Draw& draw) {
    const Answer answer = picture(server, request_json().dump(), draw);
    CHECK(answer.status == 500);
    CHECK(one_line(answer.body));
    return answer.body;
  };
  CHECK(thrown([](const PictureRequest&) -> Picture { fail(ErrorKind::memory, "too expensive"); }) ==
        "too expensive\n");
  thrown([](const PictureRequest&) -> Picture { throw std::bad_alloc(); });
  thrown([](const PictureRequest&) -> Picture { throw std::runtime_error("OpenCV\nwrites\r\nlines"); });
  thrown([](const PictureRequest&) -> Picture { throw std::runtime_error(std::string(10000, 'x')); });
  thrown([](const PictureRequest&) -> Picture { return {Json::parse("{")}; });
  thrown([](const PictureRequest&) -> Picture { throw 7; });
  CHECK(picture(server, request_json().dump()).status == 200);
}

TEST_CASE("requests with numbers of a wrong type or out of range are rejected") {
  Started server;
  const auto refused = [&](const std::string& body) {
    INFO(body.substr(0, 200));
    const Answer answer = picture(server, body);
    CHECK(answer.status == 400);
    CHECK(one_line(answer.body));
  };
  const auto changed = [](const char* name, const Json& value) {
    Json request = request_json();
    request["camera"][name] = value;
    return request.dump();
  };
  for (const char* value : {"4294967304", "18446744073709551624", "-8", "true", "8.5", "8.0", "1e300",
                            "\"8\"", "null", "[8]", "0", "16385"})
    for (const char* name : {"width", "height"}) refused(changed(name, Json::parse(value)));
  for (const char* value : {"true", "1e300", "-1e300", "\"8\"", "null", "[8]"})
    for (const char* name : {"fx", "cy", "time"}) refused(changed(name, Json::parse(value)));
  refused(changed("fx", -1));
  refused(changed("rotation", {2, 0, 0, 0, 1, 0, 0, 0, 1}));
  refused(changed("rotation", {true, 0, 0, 0, 1, 0, 0, 0, 1}));
  refused(changed("rotation", {1, 0, 0}));
  refused(changed("translation", {1e300, 0, 0}));
  refused(changed("extra", {true}));
  refused(changed("extra", {1e300}));
  Json request = request_json();
  request["camera"]["width"] = 65535, request["camera"]["height"] = 31;  // wider than kMaxPictureSide
  refused(request.dump());
  request["camera"]["width"] = request["camera"]["height"] = 3000;
  refused(request.dump());
  request = request_json();
  request["exact"] = 1;
  refused(request.dump());
  request["camera"].erase("width");
  refused(request.dump());
  for (const std::string text :
       {"", "{", "[]", "7", "{}", "{\"camera\": 7}", "{\"camera\": {\"fx\": 1e999}}"})
    refused(text);
  refused(std::string(3000, '['));
  CHECK(picture(server, request_json().dump()).status == 200);
}

TEST_CASE("requests that the page would not send are rejected") {
  Started server;
  const std::string body = request_json().dump(), json = "Content-Type: application/json\r\n";
  const auto status = [&](const std::string& request) { return answer_of(server, request).status; };
  CHECK(status(get("/nothing")) == 404);
  CHECK(status(get("/picture")) == 404);
  CHECK(status("DELETE / HTTP/1.1\r\nHost: localhost\r\n\r\n") == 405);
  CHECK(status(get("/state", "Host: evil.example\r\n")) == 421);
  CHECK(status(get("/state", "")) == 421);
  CHECK(status(get("/state", "Host: localhost\r\nOrigin: http://evil.example\r\n")) == 403);
  CHECK(status(post(body, json + "Origin: null\r\n")) == 403);
  CHECK(status(post(body, "Content-Type: text/plain\r\n")) == 415);
  CHECK(status(post(body, "Content-Type: multipart/form-data; boundary=x\r\n")) == 415);
  CHECK(status(post(body, json + "Content-Encoding: gzip\r\n")) == 415);
  CHECK(status(post(body, json + "Transfer-Encoding: chunked\r\n")) == 415);
  CHECK(status("POST /picture HTTP/1.1\r\nHost: localhost\r\n" + json + "\r\n" + body) == 411);
  CHECK(status(post(std::string(5000, ' '))) == 413);
  const Answer refused = answer_of(server, get("/nothing"));
  CHECK(one_line(refused.body));
  CHECK(refused.head.find("EXCEPTION") == std::string::npos);
}

TEST_CASE("requests have a limited size, and answers support neither ranges nor compression") {
  Started server;
  const auto with = [](const std::string& headers) { return get("/", "Host: localhost\r\n" + headers); };
  CHECK(answer_of(server, std::string("\0\1\2\3\r\n\r\n", 8)).status != 200);
  CHECK(answer_of(server, with("X: " + std::string(20000, 'x') + "\r\n")).status == 0);
  CHECK(answer_of(server, get("/" + std::string(20000, 'x'))).status == 0);
  std::string lines;
  for (int i = 0; i < 100000; ++i) lines += "X: x\r\n";
  CHECK(answer_of(server, with(lines)).status == 0);
  // Long ranges would need more stack than some threads have, and many ranges would multiply the size of the
  // page.
  std::string ranges = "bytes=0-0";
  while (ranges.size() < 8000) ranges += ",0-9";
  for (const std::string& header : std::vector<std::string>{
           "Range: bytes=0-1", "range: bytes=0-1,2-3", "RANGE: " + ranges, "Accept-Encoding: gzip, br"}) {
    const Answer answer = answer_of(server, with(header + "\r\n"));
    CHECK(answer.status == 200);
    CHECK(answer.body == "<p>page</p>");
  }
}

TEST_CASE("only the first request of a connection is answered") {
  Started server;
  std::string requests;
  for (int i = 0; i < 500; ++i) requests += get("/state");
  const Client client(server);
  client.send(requests);
  const std::string text = client.all();
  CHECK(text.starts_with("HTTP/1.1 200"));
  CHECK(text.find("HTTP/1.1", 1) == std::string::npos);
}

// The limit bounds the processor time of the server, however many requests clients send.
TEST_CASE("at most 50 connections per second are accepted") {
  Started server;
  constexpr int kConnections = 20;
  const Stopwatch watch;
  std::vector<Client> clients;
  for (int i = 0; i < kConnections; ++i) {
    clients.emplace_back(server);
    clients.back().send(get("/state"));
  }
  for (const Client& client : clients) CHECK(client.answer().status == 200);
  CHECK(watch.seconds() >= (kConnections - 1) / 50.0);
}

TEST_CASE("open connections without requests do not block other clients") {
  Started server("0.0.0.0");
  const std::string token = server.url().substr(server.url().find('?'));
  std::vector<Client> held;
  for (int i = 0; i < 100; ++i) {
    held.emplace_back(server);
    if (i % 4 == 1) held.back().send("GET /state");           // the request is incomplete
    if (i % 4 == 2) held.back().send(get("/state"));          // the request has no token
    if (i % 4 == 3) held.back().send(post("{}").substr(40));  // the request is invalid
  }
  for (int i = 0; i < 10; ++i) CHECK(answer_of(server, get("/state" + token)).status == 200);
  CHECK(answer_of(server, get("/state")).status == 403);
  CHECK(answer_of(server, get("/state?token=" + std::string(32, '0'))).status == 403);
}

TEST_CASE("requests whose bodies are incomplete do not block other clients") {
  Started server;
  std::vector<Client> slow;
  for (int i = 0; i < 40; ++i) {
    slow.emplace_back(server);
    slow.back().send(
        "POST /picture HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        "Content-Length: 4000\r\n\r\n{");
  }
  for (int i = 0; i < 5; ++i) CHECK(answer_of(server, get("/state")).status == 200);
  CHECK(picture(server, request_json().dump()).status == 200);
  CHECK(server.requests() == 6);  // an incomplete request is not one of a viewer
}

TEST_CASE("if there are not enough descriptors, idle and ended connections are closed") {
  Started server;
  std::vector<int> sockets;
  for (int i = 0; i < 12; ++i) sockets.push_back(::socket(AF_INET, SOCK_STREAM, 0));
  const int used = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
  rlimit before{};
  REQUIRE(::getrlimit(RLIMIT_NOFILE, &before) == 0);
  const rlimit few{.rlim_cur = static_cast<rlim_t>(used) + 4, .rlim_max = before.rlim_max};
  REQUIRE(::setrlimit(RLIMIT_NOFILE, &few) == 0);  // the server can accept at most three connections
  std::vector<int> answers;
  {
    std::vector<Client> idle;
    for (int i = 0; i < 10; ++i) idle.emplace_back(sockets[static_cast<std::size_t>(i)], server);
    const Client good(sockets[10], server);
    good.send(get("/state"));
    answers.push_back(good.answer().status);
    // The clients leave, but their descriptors remain in use.
    for (int i = 0; i < 10; ++i) ::dup2(used, sockets[static_cast<std::size_t>(i)]);
    const Client next(sockets[11], server);
    next.send(get("/state"));
    answers.push_back(next.answer().status);
  }
  ::setrlimit(RLIMIT_NOFILE, &before);
  ::close(used);
  CHECK(answers == std::vector<int>{200, 200});
}

TEST_CASE("pages of other origins can link to the page, but neither embed it nor request anything else") {
  Started server;
  const auto status = [&](const char* path, const char* site, const char* mode, const char* dest) {
    return answer_of(server, get(path, fmt::format("Host: localhost\r\nSec-Fetch-Site: {}\r\nSec-Fetch-Mode: "
                                                   "{}\r\nSec-Fetch-Dest: {}\r\n",
                                                   site, mode, dest)))
        .status;
  };
  for (const char* site : {"cross-site", "same-site"}) {
    CHECK(status("/", site, "no-cors", "image") == 403);
    CHECK(status("/state", site, "no-cors", "image") == 403);
    CHECK(status("/state", site, "navigate", "document") == 403);
    CHECK(status("/", site, "navigate", "iframe") == 403);
  }
  CHECK(server.requests() == 0);  // such a request is not one of a viewer
  CHECK(status("/", "cross-site", "navigate", "document") == 200);
  CHECK(status("/", "none", "navigate", "document") == 200);
  CHECK(status("/state", "same-origin", "cors", "empty") == 200);
  CHECK(answer_of(server, get("/")).head.find("\r\nX-Frame-Options: DENY") != std::string::npos);
}

TEST_CASE("closing does not wait for clients that send nothing, send slowly or do not read") {
  std::optional<Started> server(std::in_place);
  std::vector<Client> held;
  for (int i = 0; i < 20; ++i) {
    held.emplace_back(*server);
    if (i % 2 == 0) held.back().send("GET / HTTP/1.1\r\n");
  }
  const Client deaf(*server);
  deaf.send(post(request_json().dump()));
  // The answer has more bytes than the buffers of the system can hold.
  while (!server->serve(10ms, [](const PictureRequest&) {
    return Picture{std::string(100 << 20, 'x'), {}};
  })) {
  }
  const Stopwatch watch;
  server.reset();
  CHECK(watch.seconds() < kPrompt);
}

TEST_CASE("clients that wait for an image at the end are informed that the server has stopped") {
  int status = 0;
  for (int round = 0; round < 100 && status == 0; ++round) {
    std::optional<Started> server(std::in_place);
    const Client waiting(*server);
    waiting.send(post(request_json().dump()));
    std::this_thread::sleep_for(round * 20ms);  // with a short time, the request may arrive after the end
    server.reset();
    status = waiting.answer().status;
  }
  CHECK(status == 410);
}

TEST_CASE("an address that is not local, in use or empty is a usage error") {
  const Started server;
  const std::string& url = server.url();
  const int taken = std::stoi(url.substr(url.rfind(':') + 1));
  for (const Address& address :
       {Address{"", 0}, Address{" ", 0}, Address{"192.0.2.1", 0}, {"127.0.0.1", taken}}) {
    INFO(address.host);
    try {
      const Server refused(address);
      FAIL("the server was started, but an error was expected");
    } catch (const Error& error) {
      CHECK(error.kind() == ErrorKind::usage);
      CHECK(std::string(error.what()).find('\n') == std::string::npos);
    }
  }
}

}  // namespace
}  // namespace ubs::serve
