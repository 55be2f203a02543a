// SPDX-License-Identifier: Apache-2.0
#include "host/look/serve/server.hpp"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <csignal>
#include <cstring>
#include <deque>
#include <list>
#include <mutex>
#include <optional>
#include <thread>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "host/look/serve/http.hpp"
#include "host/scene/camera_json.hpp"

namespace ubs::serve {
namespace {

using namespace std::chrono_literals;
using Seconds = std::chrono::duration<double>;

constexpr std::size_t kMaxConnections = 32;
constexpr int kBacklog = 64;  // connections that the system queues before they are accepted
constexpr double kPictureSeconds = 120, kClosingSeconds = 1;
constexpr auto kPeerCheck = 200ms;
// Pause between two connections. An answer takes 0.5 ms of processor time in addition to rendering, and 0.8
// ms with the longest headers (measured on an AMD EPYC). With this pause, the threads of the server use at
// most 2 to 4 % of one processor.
constexpr auto kBetweenConnections = 20ms;

// If no client connects, ended connections are closed after this time.
constexpr int kForgetMilliseconds = 200;

std::string random_token() {
  std::array<unsigned char, 16> bytes{};
  if (getentropy(bytes.data(), bytes.size()) != 0)
    fail(ErrorKind::internal, "cannot get random numbers for a token");
  std::string token;
  for (const unsigned char byte : bytes) token += fmt::format("{:02x}", byte);
  return token;
}

PictureRequest read_request(const std::string& body) {
  const Json json = parse_json(body, "request");
  if (!json.is_object()) fail(ErrorKind::data, "request: not a JSON object");
  const auto camera = json.find("camera");
  if (camera == json.end()) fail(ErrorKind::data, "request: the camera is missing");
  PictureRequest request{.camera = camera_of(*camera)};
  check_camera(request.camera, "request");
  const std::int64_t width = request.camera.width, height = request.camera.height;
  if (width * height > kMaxPicturePixels || std::max(width, height) > kMaxPictureSide)
    fail(ErrorKind::data, "request: images can have at most {} pixels, and at most {} in a row or column",
         kMaxPicturePixels, kMaxPictureSide);
  if (const auto exact = json.find("exact"); exact != json.end()) {
    if (!exact->is_boolean()) fail(ErrorKind::data, "request: 'exact' must be true or false");
    request.exact = exact->get<bool>();
  }
  return request;
}

HttpReply picture_reply(const Server::Draw& draw, const PictureRequest& request) {
  try {
    Picture picture = draw(request);
    return {.type = request.exact ? "image/png" : "image/jpeg",
            .body = std::move(picture.bytes),
            .headers = std::move(picture.headers)};
  } catch (const std::bad_alloc&) {
    return {.status = 500, .body = "out of memory"};
  } catch (const std::exception& error) {
    return {.status = 500, .body = error.what()};
  } catch (...) {
    return {.status = 500, .body = "unknown error"};
  }
}

// Connection is an accepted connection. Its destructor closes the socket.
struct Connection {
  explicit Connection(int descriptor) : socket(descriptor) {}
  Connection(const Connection&) = delete;
  ~Connection() { ::close(socket); }

  const int socket;
  std::atomic<bool> admitted = false;  // the request is complete and allowed
  bool done = false;                   // guarded by the server's mutex
  std::thread thread;
};

struct PendingPicture {
  PictureRequest request;
  std::optional<HttpReply> reply;
};

}  // namespace

struct Server::Implementation {
  Site site;
  std::string url;
  int listener = -1;
  std::unique_ptr<Http> http;
  std::atomic<std::uint64_t> requests = 0;

  std::mutex mutex;  // protects the members from here to `pending`
  std::condition_variable changed;
  bool closing = false;
  std::string state = "{}";
  std::deque<std::shared_ptr<PendingPicture>> pending;

  // Only the accepting thread uses this list and, after that thread has ended, the destructor. The oldest
  // connections are at the front.
  std::list<Connection> connections;
  std::thread accepting;

  // Listens on the first usable address of the host.
  void open(const Address& address) {
    if (address.host.empty())
      fail(ErrorKind::usage, "the host to listen on is empty: pass a name or an address");
    const auto refuse = [&](const char* why) {
      fail(ErrorKind::usage, "cannot listen on port {} of {}: {}: choose another port, or 0 for any free one",
           address.port, address.host, why);
    };
    addrinfo hints{};
    hints.ai_flags = AI_NUMERICSERV;
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    const int error = getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(), &hints, &found);
    if (error != 0) refuse(gai_strerror(error));
    const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owned(found, freeaddrinfo);
    int reason = EADDRNOTAVAIL;
    for (; found && listener < 0; found = found->ai_next) {
      listener = ::socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
      const int on = 1;
      if (listener >= 0 && ::setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
          ::bind(listener, found->ai_addr, found->ai_addrlen) == 0 && ::listen(listener, kBacklog) == 0)
        break;
      reason = errno;
      if (listener >= 0) ::close(std::exchange(listener, -1));
    }
    if (listener < 0) refuse(std::strerror(reason));
    describe(address);
  }

  void describe(const Address& address) {
    sockaddr_storage place{};
    socklen_t size = sizeof place;
    auto* const any = reinterpret_cast<sockaddr*>(&place);
    std::array<char, NI_MAXHOST> text{};
    std::array<char, NI_MAXSERV> port{};
    ::getsockname(listener, any, &size);
    ::getnameinfo(any, size, text.data(), text.size(), port.data(), port.size(),
                  NI_NUMERICHOST | NI_NUMERICSERV);
    const std::string_view number = text.data();
    site.host = address.host;
    site.loopback = number.starts_with("127.") || number == "::1";
    if (!site.loopback) site.token = random_token();
    std::string name = address.host;
    if (number == "0.0.0.0" || number == "::")
      if (::gethostname(text.data(), text.size() - 1) == 0) name = text.data();
    if (name.find(':') != std::string::npos) name = "[" + name + "]";
    url = fmt::format("http://{}:{}/{}", name, port.data(), site.loopback ? "" : "?token=" + site.token);
  }

  // Waits between two connections. Returns false if the server is closing.
  bool rest() {
    std::unique_lock lock(mutex);
    return !changed.wait_for(lock, kBetweenConnections, [&] { return closing; });
  }

  void accept() noexcept {
    while (rest()) {
      forget_done();
      pollfd one{.fd = listener, .events = POLLIN, .revents = 0};
      if (::poll(&one, 1, connections.empty() ? -1 : kForgetMilliseconds) <= 0) continue;
      const int socket = ::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC);
      if (socket >= 0)
        take(socket);
      else if (errno == EMFILE || errno == ENFILE)  // the process or the system has no more descriptors
        displace();
    }
  }

  void take(int socket) noexcept {
    std::list<Connection> one;
    if (connections.size() < kMaxConnections || displace()) try {
        one.emplace_back(socket);
      } catch (const std::bad_alloc&) {
      }
    if (one.empty()) {
      ::close(socket);
      return;
    }
    const int on = 1;
    ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    try {
      one.back().thread = std::thread([this, &connection = one.back()] { converse(connection); });
      connections.splice(connections.end(), one);
    } catch (const std::exception&) {  // the system has no more threads
    }
  }

  void forget_done() {
    std::list<Connection> done;
    {
      const std::lock_guard lock(mutex);
      for (auto one = connections.begin(); one != connections.end();)
        if (const auto here = one++; here->done) done.splice(done.end(), connections, here);
    }
    for (Connection& one : done) one.thread.join();
  }

  // Ends the oldest connection whose request is not complete or not allowed, so that idle connections cannot
  // keep others out.
  bool displace() {
    const auto oldest =
        std::find_if(connections.begin(), connections.end(), [](const Connection& c) { return !c.admitted; });
    if (oldest == connections.end()) return false;
    ::shutdown(oldest->socket, SHUT_RDWR);
    oldest->thread.join();
    connections.erase(oldest);
    return true;
  }

  void converse(Connection& connection) noexcept {
    http->answer(connection.socket, [&] {
      connection.admitted = true;
      ++requests;
    });
    ::shutdown(connection.socket, SHUT_RDWR);
    const std::lock_guard lock(mutex);
    connection.done = true;
    changed.notify_all();
  }

  HttpReply picture(const std::string& body, const std::function<bool()>& gone) {
    const auto own = std::make_shared<PendingPicture>(PendingPicture{read_request(body), {}});
    std::unique_lock lock(mutex);
    pending.push_back(own);
    changed.notify_all();
    const Stopwatch watch;
    while (!changed.wait_for(lock, kPeerCheck, [&] { return own->reply || closing; }))
      if (watch.seconds() > kPictureSeconds || gone()) break;
    std::erase(pending, own);
    if (own->reply) return std::move(*own->reply);
    if (closing) return {.status = 410, .body = "the program has ended"};
    return {.status = 503, .body = "the image was not rendered in time: repeat the request"};
  }

  void close() {
    {
      const std::lock_guard lock(mutex);
      closing = true;
    }
    changed.notify_all();
    if (listener >= 0) ::shutdown(listener, SHUT_RDWR);  // ends the wait for connections
    if (accepting.joinable()) accepting.join();
    for (const Connection& one : connections) ::shutdown(one.socket, SHUT_RD);  // no more requests
    {
      std::unique_lock lock(mutex);
      changed.wait_for(lock, Seconds(kClosingSeconds), [&] {
        return std::all_of(connections.begin(), connections.end(),
                           [](const Connection& c) { return c.done; });
      });
    }
    for (const Connection& one : connections) ::shutdown(one.socket, SHUT_RDWR);
    for (Connection& one : connections) one.thread.join();
    if (listener >= 0) ::close(listener);
  }
};

Server::Server(const Address& address) : own_(std::make_unique<Implementation>()) { own_->open(address); }

Server::~Server() { own_->close(); }

const std::string& Server::url() const { return own_->url; }

std::uint64_t Server::requests() const { return own_->requests; }

void Server::start(std::string page) {
  Implementation& own = *own_;
  own.site.page = std::move(page);
  own.site.state = [&own] {
    const std::lock_guard lock(own.mutex);
    return own.state;
  };
  own.site.picture = [&own](const std::string& body, const std::function<bool()>& gone) {
    return own.picture(body, gone);
  };
  own.http = std::make_unique<Http>(own.site);
  // Block signals in the server's threads, so that the main thread handles them.
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  own.accepting = std::thread([&own] { own.accept(); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

void Server::publish(std::string state) {
  const std::lock_guard lock(own_->mutex);
  own_->state = std::move(state);
}

bool Server::serve(std::chrono::milliseconds wait, const Draw& draw) {
  Implementation& own = *own_;
  std::unique_lock lock(own.mutex);
  if (!own.changed.wait_for(lock, wait, [&] { return !own.pending.empty(); })) return false;
  const std::shared_ptr<PendingPicture> next = own.pending.front();
  own.pending.pop_front();
  lock.unlock();
  HttpReply reply{.status = 500};
  try {
    reply = picture_reply(draw, next->request);
    // If there is not even memory for an error message, send an empty answer.
  } catch (const std::bad_alloc&) {
  }
  lock.lock();
  next->reply = std::move(reply);
  own.changed.notify_all();
  return true;
}

}  // namespace ubs::serve
