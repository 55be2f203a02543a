// SPDX-License-Identifier: Apache-2.0
#include "host/serve/server.hpp"
// clang-format off
#include <utility>  // Boost 1.74 forgets it
// clang-format on

#include <fcntl.h>
#include <sys/random.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/host_name.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <csignal>
#include <ctime>
#include <future>
#include <map>
#include <thread>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "host/scene/camera_json.hpp"
#include "host/serve/wishes.hpp"

namespace ubs::serve {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using boost::system::error_code;
using Request = http::request<http::empty_body>;
using Response = http::response<http::string_body>;
using namespace std::chrono_literals;

constexpr std::size_t kMaxConnections = 64, kMaxHeader = 8192, kMaxMessage = 4096, kMaxReason = 120;
constexpr auto kPatience = 20s;  // with a visitor who neither reads nor writes
constexpr double kClosing = 1;   // seconds

std::string random_token() {
  std::array<unsigned char, 16> bytes{};
  if (getentropy(bytes.data(), bytes.size()) != 0) fail(ErrorKind::internal, "no random numbers for a token");
  std::string token;
  for (const unsigned char byte : bytes) token += fmt::format("{:02x}", byte);
  return token;
}

// In a time that does not depend on where they differ.
bool same_token(std::string_view given, std::string_view token) {
  unsigned different = given.size() == token.size() ? 0 : 1;
  for (std::size_t i = 0; i < token.size(); ++i)
    different |= static_cast<unsigned char>(token[i] ^ (i < given.size() ? given[i] : 0));
  return different == 0;
}

std::string_view parameter(std::string_view target, std::string_view name) {
  std::string_view rest = target.substr(std::min(target.find('?'), target.size()));
  while (!rest.empty()) {
    rest.remove_prefix(1);
    const std::string_view part = rest.substr(0, rest.find('&'));
    rest.remove_prefix(part.size());
    if (part.starts_with(name) && part.substr(name.size()).starts_with('='))
      return part.substr(name.size() + 1);
  }
  return {};
}

std::string_view without_port(std::string_view host) {
  return host.starts_with('[') ? host.substr(0, host.find(']') + 1) : host.substr(0, host.find(':'));
}

std::string_view view_of(beast::string_view text) { return {text.data(), text.size()}; }

void close_on_exec(int descriptor) { fcntl(descriptor, F_SETFD, FD_CLOEXEC); }

double cpu_seconds() {  // of this thread
  timespec used{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
  return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
}

// Sleeps as long as keeps this thread within its share of the processors.
class Throttle {
 public:
  explicit Throttle(double share) : share_(share * std::max(1u, std::thread::hardware_concurrency())) {}
  void rest(const std::atomic<bool>& stop) {
    const double now = cpu_seconds();
    free_ = std::max(free_, time_.seconds()) + (now - used_) / share_;
    used_ = now;
    for (double left = 0; (left = free_ - time_.seconds()) > 1e-3 && !stop;)
      std::this_thread::sleep_for(std::chrono::duration<double>(std::min(left, 0.05)));
  }

 private:
  double share_, used_ = cpu_seconds();
  const TimeSource& time_ = steady_time();
  double free_ = time_.seconds();
};

Wish read_wish(const std::string& text) {
  const Json json = parse_json(text, "message");
  Wish wish{.id = json.at("id").get<std::int64_t>(),
            .camera = camera_of(json.at("camera")),
            .exact = json.value("exact", false)};
  check_camera(wish.camera, "message");
  if (static_cast<std::int64_t>(wish.camera.width) * wish.camera.height > kMaxPixels)
    fail(ErrorKind::data, "message: pictures have at most {} pixels", kMaxPixels);
  return wish;
}

struct Visitor {
  explicit Visitor(beast::tcp_stream stream)
      : socket(std::move(stream)), wake(socket.get_executor()), deadline(socket.get_executor()) {}
  websocket::stream<beast::tcp_stream, false> socket;  // pictures do not deflate
  asio::steady_timer wake;                             // of the coroutine that sends
  asio::steady_timer deadline;                         // for what it sends
  std::uint64_t number = 0;
  std::optional<Wish> last, later;   // the newest wish; the one that waits for the end of a picture
  std::optional<std::string> frame;  // to be sent
  bool busy = false;                 // with a picture that is drawn or sent
  bool gone = false;

  void leave() {
    gone = true;
    beast::get_lowest_layer(socket).close();
    wake.cancel();
    deadline.cancel();
  }
};

}  // namespace

struct Server::Implementation {
  bool loopback = true, closing = false;
  std::string host, token, url, page;
  std::mutex state_mutex;
  std::string state = "{}";
  Wishes wishes;
  std::map<std::uint64_t, std::shared_ptr<Visitor>> visitors;
  std::uint64_t visitors_so_far = 0;
  std::size_t connections = 0;
  std::thread thread;
  std::atomic<bool> stop = false;
  // Last: what still waits in it refers to the members before.
  asio::io_context io{1};
  tcp::acceptor acceptor{io};

  void open(const Address& address) {
    host = address.host;
    tcp::resolver resolver(io);
    const tcp::endpoint wanted = *resolver
                                      .resolve(address.host, std::to_string(address.port),
                                               tcp::resolver::passive | tcp::resolver::numeric_service)
                                      .begin();
    acceptor.open(wanted.protocol());
    close_on_exec(acceptor.native_handle());
    acceptor.set_option(tcp::acceptor::reuse_address(true));
    acceptor.bind(wanted);
    acceptor.listen();
    const tcp::endpoint place = acceptor.local_endpoint();
    loopback = place.address().is_loopback();
    if (!loopback) token = random_token();
    std::string name = place.address().is_unspecified() ? asio::ip::host_name() : host;
    if (name.find(':') != std::string::npos) name = "[" + name + "]";
    url = fmt::format("http://{}:{}/{}", name, place.port(), loopback ? "" : "?token=" + token);
  }

  void run(double cpu_share) {
    const auto work = asio::make_work_guard(io);
    asio::co_spawn(io, accept(), asio::detached);
    Throttle throttle(cpu_share);
    Stopwatch closes;
    while (!closing || (!visitors.empty() && closes.seconds() < kClosing)) {
      if (!closing) closes.restart();
      if (io.run_one_for(50ms) > 0) io.poll();
      throttle.rest(stop);
    }
  }

  void close() {
    closing = true;
    error_code ignored;
    acceptor.close(ignored);
    for (auto& [number, visitor] : visitors) visitor->wake.cancel();
  }

  asio::awaitable<void> accept() {
    asio::steady_timer pause(io);
    while (!closing) {
      error_code error;
      tcp::socket socket = co_await acceptor.async_accept(asio::redirect_error(asio::use_awaitable, error));
      if (error) {  // no descriptors left, or a visitor who went away at once
        pause.expires_after(100ms);
        co_await pause.async_wait(asio::redirect_error(asio::use_awaitable, error));
        continue;
      }
      close_on_exec(socket.native_handle());
      socket.set_option(tcp::no_delay(true), error);
      if (connections < kMaxConnections)
        asio::co_spawn(io, session(beast::tcp_stream(std::move(socket))), asio::detached);
    }
  }

  asio::awaitable<void> session(beast::tcp_stream stream) {
    ++connections;
    try {
      co_await converse(std::move(stream));
    } catch (const std::exception&) {  // gone, too slow, or does not speak HTTP
    }
    --connections;
  }

  asio::awaitable<void> converse(beast::tcp_stream stream) {
    beast::flat_buffer buffer(2 * kMaxHeader);
    for (;;) {
      http::request_parser<http::empty_body> parser;
      parser.header_limit(kMaxHeader);
      stream.expires_after(kPatience);
      co_await http::async_read(stream, buffer, parser, asio::use_awaitable);
      const Request request = parser.release();
      Response response = answer(request);
      if (response.result() == http::status::switching_protocols) {
        stream.expires_never();  // its WebSocket has deadlines of its own
        co_await receive(std::make_shared<Visitor>(std::move(stream)), request);
        co_return;
      }
      stream.expires_after(kPatience);
      co_await http::async_write(stream, response, asio::use_awaitable);
      if (!response.keep_alive()) co_return;
    }
  }

  bool host_allowed(std::string_view given) const {
    const std::string_view name = without_port(given);
    // Where others reach us they need the token, which a page that a name was bent for does not know.
    return !loopback || name == "localhost" || name == "127.0.0.1" || name == "[::1]" || name == host;
  }

  bool same_origin(const Request& request) const {
    if (!request.count(http::field::origin)) return true;  // no browser
    return view_of(request[http::field::origin]) ==
           "http://" + std::string(view_of(request[http::field::host]));
  }

  Response answer(const Request& request) {
    const std::string_view target = view_of(request.target()), path = target.substr(0, target.find('?'));
    Response response{http::status::ok, request.version()};
    response.keep_alive(request.keep_alive());
    response.set(http::field::cache_control, "no-store");
    response.set("Referrer-Policy", "no-referrer");  // the address may hold the token
    response.set("X-Content-Type-Options", "nosniff");
    response.set("Cross-Origin-Resource-Policy", "same-origin");
    response.set(http::field::content_type, "text/plain");
    const auto refuse = [&](http::status status, const char* why) {
      response.result(status);
      response.body() = fmt::format("{}\n", why);
    };
    if (!host_allowed(view_of(request[http::field::host])))
      refuse(http::status::misdirected_request, "this server has another name");
    else if (!token.empty() && !same_token(parameter(target, "token"), token))
      refuse(http::status::forbidden, "the address that ubs printed has a token");
    else if (request.method() != http::verb::get)
      refuse(http::status::method_not_allowed, "nothing but GET");
    else if (path == "/live" && websocket::is_upgrade(request) && same_origin(request))
      response.result(http::status::switching_protocols);
    else if (path == "/live")
      refuse(http::status::forbidden, "for the page of this server alone");
    else if (path == "/") {
      response.set(http::field::content_type, "text/html; charset=utf-8");
      response.body() = page;
    } else if (path == "/state") {
      response.set(http::field::content_type, "application/json");
      const std::lock_guard lock(state_mutex);
      response.body() = state;
    } else {
      refuse(http::status::not_found, "there are /, /state and /live");
    }
    response.prepare_payload();
    return response;
  }

  asio::awaitable<void> receive(std::shared_ptr<Visitor> visitor, const Request& request) {
    auto& socket = visitor->socket;
    socket.set_option(websocket::stream_base::timeout{kPatience, 2 * kPatience, true});
    socket.read_message_max(kMaxMessage);
    socket.auto_fragment(false);
    socket.binary(true);
    co_await socket.async_accept(request, asio::use_awaitable);
    visitor->number = ++visitors_so_far;
    visitors[visitor->number] = visitor;
    asio::co_spawn(io, send(visitor), asio::detached);
    try {
      co_await listen(*visitor);
    } catch (const std::exception&) {  // closed, gone, or broken frames
    }
    visitor->leave();
    wishes.drop(visitor->number);
    visitors.erase(visitor->number);
  }

  asio::awaitable<void> listen(Visitor& visitor) {
    beast::flat_buffer buffer;
    for (;;) {
      co_await visitor.socket.async_read(buffer, asio::use_awaitable);
      std::string why;
      try {
        Wish wish = read_wish(beast::buffers_to_string(buffer.data()));
        wish.visitor = visitor.number;
        visitor.last = wish;
        ask(visitor, wish);
      } catch (const std::exception& error) {
        why = error.what();
      }
      buffer.consume(buffer.size());
      if (why.empty()) continue;
      if (closing) co_return;
      visitor.gone = true;  // for the coroutine that sends
      visitor.wake.cancel();
      why.resize(std::min(why.size(), kMaxReason));
      const websocket::close_reason reason(websocket::close_code::policy_error, why);
      co_await visitor.socket.async_close(reason, asio::use_awaitable);
      co_return;
    }
  }

  // One picture at a time for each visitor: of the wishes that come meanwhile the last one counts.
  void ask(Visitor& visitor, const Wish& wish) {
    if (!std::exchange(visitor.busy, true))
      wishes.put(wish);
    else if (!wishes.replace(wish))  // it is drawn or sent
      visitor.later = wish;
  }

  asio::awaitable<void> send(std::shared_ptr<Visitor> visitor) {
    error_code error;
    while (!visitor->gone && !error) {
      if (visitor->frame) {
        visitor->deadline.expires_after(kPatience);
        visitor->deadline.async_wait([visitor](error_code stopped) {
          if (!stopped) visitor->leave();
        });
        co_await visitor->socket.async_write(asio::buffer(*visitor->frame),
                                             asio::redirect_error(asio::use_awaitable, error));
        visitor->deadline.cancel();
        visitor->frame.reset();
        visitor->busy = false;
        if (const std::optional<Wish> wish = std::exchange(visitor->later, {})) ask(*visitor, *wish);
      } else if (closing) {
        const websocket::close_reason reason(websocket::close_code::going_away, "ended");
        co_await visitor->socket.async_close(reason, asio::redirect_error(asio::use_awaitable, error));
        co_return;
      } else {
        visitor->wake.expires_at(asio::steady_timer::time_point::max());
        error_code woken;
        co_await visitor->wake.async_wait(asio::redirect_error(asio::use_awaitable, woken));
      }
    }
  }

  void deliver(std::uint64_t number, std::string frame) {
    const auto found = visitors.find(number);
    if (found == visitors.end()) return;
    found->second->frame = std::move(frame);
    found->second->wake.cancel();
  }
};

Server::Server(const Address& address) : own_(std::make_unique<Implementation>()) {
  try {
    own_->open(address);
  } catch (const boost::system::system_error& error) {
    fail(ErrorKind::usage, "cannot serve on port {} of {}: {}; another port, or 0 for a free one?",
         address.port, address.host, error.code().message());
  }
}

Server::~Server() {
  if (!own_->thread.joinable()) return;
  asio::post(own_->io, [this] { own_->close(); });
  own_->stop = true;
  own_->thread.join();
  own_->visitors.clear();  // before `io`, which their sockets are of
}

const std::string& Server::url() const { return own_->url; }

void Server::start(std::string page, double cpu_share) {
  own_->page = std::move(page);
  // Signals are for the thread that works.
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  own_->thread = std::thread([this, cpu_share] { own_->run(cpu_share); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

void Server::publish(std::string state) {
  const std::lock_guard lock(own_->state_mutex);
  own_->state = std::move(state);
}

std::optional<Wish> Server::next(std::chrono::milliseconds wait,
                                 const std::function<bool(const Wish&)>& take) {
  return own_->wishes.next(wait, take);
}

void Server::answer(const Wish& wish, const std::string& header, const std::string& picture) {
  const auto length = static_cast<std::uint32_t>(header.size());
  std::string frame;
  for (int byte = 0; byte < 4; ++byte) frame += static_cast<char>(length >> (8 * byte) & 255);
  frame += header;
  frame += picture;
  asio::post(own_->io, [this, number = wish.visitor, frame = std::move(frame)]() mutable {
    own_->deliver(number, std::move(frame));
  });
}

void Server::ask_again() {
  if (!own_->thread.joinable()) return;
  std::promise<void> asked;
  asio::post(own_->io, [&] {
    for (auto& [number, visitor] : own_->visitors)
      if (visitor->last) own_->ask(*visitor, *visitor->last);
    asked.set_value();
  });
  asked.get_future().wait();
}

}  // namespace ubs::serve
