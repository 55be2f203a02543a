// SPDX-License-Identifier: Apache-2.0
// See svg_chart.hpp.
#include "host/report/svg_chart.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/base/error.hpp"
#include "host/report/report_sections.hpp"

namespace ubs {
namespace {

constexpr double kSvgLeft = 52, kSvgRight = 12, kSvgTop = 28, kSvgBottom = 40;
constexpr std::size_t kSvgColours = 7;

struct SvgAxis {
  double low = 0, high = 1;  // log10 on logarithmic axes
  bool logarithmic = false;
  double begin = 0, end = 1;  // pixels

  bool shows(double v) const { return std::isfinite(v) && (!logarithmic || v > 0); }
  double unit(double v) const { return logarithmic ? std::log10(v) : v; }
  double value(double unit) const { return logarithmic ? std::pow(10.0, unit) : unit; }
  double pixel(double v) const { return begin + (unit(v) - low) / (high - low) * (end - begin); }
};

struct Frame {
  SvgAxis x, y;
  bool empty = true;
};

struct Point {
  double x, y;
};

double x_at(const ChartSeries& s, std::size_t i, bool right) { return s.x[s.steps && right ? i + 1 : i]; }

// An empty range, and one of a single value, get room.
void set_range(SvgAxis& axis, double low, double high, double margin_share) {
  double margin = margin_share * (high - low);
  if (!(high > low)) margin = axis.logarithmic ? 0.3 : std::max(0.5, 0.1 * std::abs(low));
  axis.low = low - margin;
  axis.high = high + margin;
}

Frame make_frame(const ChartOptions& options, std::span<const ChartSeries> series) {
  Frame f;
  f.x.logarithmic = options.log_x;
  f.y.logarithmic = options.log_y;
  const double infinity = std::numeric_limits<double>::infinity();
  double x_low = infinity, x_high = -infinity, y_low = infinity, y_high = -infinity;
  for (const ChartSeries& s : series)
    for (std::size_t i = 0; i < s.y.size(); ++i) {
      if (!f.x.shows(s.x[i]) || !f.x.shows(x_at(s, i, true)) || !f.y.shows(s.y[i])) continue;
      f.empty = false;
      x_low = std::min(x_low, f.x.unit(s.x[i]));
      x_high = std::max(x_high, f.x.unit(x_at(s, i, true)));
      y_low = std::min(y_low, f.y.unit(s.y[i]));
      y_high = std::max(y_high, f.y.unit(s.y[i]));
    }
  if (!f.empty) {
    const bool from_zero = options.y_from_zero && !options.log_y && y_low >= 0;
    const bool x_zero = options.x_from_zero && !options.log_x && x_low >= 0;
    set_range(f.x, x_zero ? 0 : x_low, x_high, 0.02);
    if (x_zero) f.x.low = 0;
    set_range(f.y, from_zero ? 0 : y_low, from_zero && y_high == 0 ? 1 : y_high, 0.06);
    if (from_zero) f.y.low = 0;
  }
  f.x.begin = kSvgLeft, f.x.end = options.width - kSvgRight;
  f.y.begin = options.height - kSvgBottom, f.y.end = kSvgTop;
  return f;
}

std::string px(double v) { return fmt::format("{:.1f}", v); }

Html svg_text(double x, double y, const std::string& style, std::string_view content) {
  return tag("text", {{"x", px(x)}, {"y", px(y)}, {"class", style}}, text(content));
}

Html axes(const ChartOptions& options, const Frame& f) {
  std::string grid;
  Html labels;
  const auto ticks = [](const SvgAxis& a) {
    return axis_ticks(a.value(a.low), a.value(a.high), a.logarithmic);
  };
  if (!f.empty) {
    for (const double t : ticks(f.x)) {
      grid += fmt::format("M{} {}V{}", px(f.x.pixel(t)), px(f.y.begin), px(f.y.end));
      labels += svg_text(f.x.pixel(t), f.y.begin + 14, "mid", tick_text(t));
    }
    for (const double t : ticks(f.y)) {
      grid += fmt::format("M{} {}H{}", px(f.x.begin), px(f.y.pixel(t)), px(f.x.end));
      labels += svg_text(f.x.begin - 6, f.y.pixel(t) + 3.5, "end", tick_text(t));
    }
  }
  const double middle = (f.x.begin + f.x.end) / 2;
  labels += svg_text(middle, 16, "mid title", options.title);
  labels += svg_text(middle, options.height - 8, "mid", options.x_label);
  const std::string turned = fmt::format("rotate(-90 12 {})", px((f.y.begin + f.y.end) / 2));
  labels += tag("text",
                {{"x", "12"}, {"y", px((f.y.begin + f.y.end) / 2)}, {"class", "mid"}, {"transform", turned}},
                text(options.y_label));
  const std::string frame =
      fmt::format("M{0} {1}H{2}V{3}H{0}Z", px(f.x.begin), px(f.y.begin), px(f.x.end), px(f.y.end));
  Html out;
  if (!grid.empty()) out += void_tag("path", {{"d", grid}, {"class", "grid"}});
  out += void_tag("path", {{"d", frame}, {"class", "frame"}});
  if (f.empty) labels += svg_text(middle, (f.y.begin + f.y.end) / 2, "mid", "nothing was recorded");
  return out + labels;
}

std::vector<Point> points_of(const Frame& f, const ChartSeries& s) {
  std::vector<Point> points;
  for (std::size_t i = 0; i < s.y.size(); ++i) {
    if (!f.x.shows(s.x[i]) || !f.y.shows(s.y[i])) continue;
    const double y = f.y.pixel(s.y[i]);
    points.push_back({f.x.pixel(s.x[i]), y});
    if (s.steps && f.x.shows(s.x[i + 1])) points.push_back({f.x.pixel(s.x[i + 1]), y});
  }
  return points;
}

// Of the points in one pixel column the lowest and the highest, in their order.
std::vector<Point> thinned(const std::vector<Point>& points) {
  std::vector<Point> out;
  for (std::size_t i = 0; i < points.size();) {
    std::size_t end = i, low = i, high = i;
    for (; end < points.size() && std::floor(points[end].x) == std::floor(points[i].x); ++end) {
      if (points[end].y < points[low].y) low = end;
      if (points[end].y > points[high].y) high = end;
    }
    out.push_back(points[std::min(low, high)]);
    if (low != high) out.push_back(points[std::max(low, high)]);
    i = end;
  }
  return out;
}

Html line(const Frame& f, const ChartSeries& s) {
  std::vector<Point> points = points_of(f, s);
  if (!s.steps) points = thinned(points);
  std::string path;
  for (const Point& p : points) path += fmt::format("{}{} {}", path.empty() ? "M" : "L", px(p.x), px(p.y));
  if (path.empty()) return {};
  const std::string style =
      fmt::format("line c{}{}{}", s.colour % kSvgColours, s.faint ? " faint" : "", s.dashed ? " dashed" : "");
  return void_tag("path", {{"d", path}, {"class", style}});
}

Html markers(const Frame& f, const ChartSeries& s) {
  Html out;
  for (std::size_t i = 0; i < s.y.size(); ++i) {
    if (!f.x.shows(s.x[i]) || !f.y.shows(s.y[i])) continue;
    const Html title = tag("title", text(fmt::format("{}: {:.6g} at {:.6g}", s.name, s.y[i], s.x[i])));
    out += tag("circle",
               {{"cx", px(f.x.pixel(s.x[i]))},
                {"cy", px(f.y.pixel(s.y[i]))},
                {"r", "3"},
                {"class", fmt::format("dot c{}", s.colour % kSvgColours)}},
               title);
  }
  return out;
}

// Beside each point, at the first of some places where no label is yet.
Html point_labels(const Frame& f, std::span<const ChartSeries> series) {
  Html out;
  std::vector<Point> taken;
  const auto free = [&](Point at) {
    return std::ranges::none_of(
        taken, [&](Point t) { return std::abs(t.x - at.x) < 14 && std::abs(t.y - at.y) < 9; });
  };
  for (const ChartSeries& s : series)
    for (std::size_t i = 0; i < s.labels.size(); ++i) {
      if (!f.x.shows(s.x[i]) || !f.y.shows(s.y[i])) continue;
      Point at{f.x.pixel(s.x[i]) + 9, f.y.pixel(s.y[i]) - 4};
      for (int k = 1; k < 8 && !free(at); ++k) at.x += k % 2 ? -18 : 18, at.y += k % 2 ? 0 : 10;
      taken.push_back(at);
      out += svg_text(at.x, at.y, "mid", s.labels[i]);
    }
  return out;
}

Html chart_legend(const Frame& f, std::span<const ChartSeries> series) {
  int crowd[2][2] = {};  // [lower][right]
  double rows = 0;
  for (const ChartSeries& s : series) {
    rows += !s.name.empty();
    for (const Point& p : points_of(f, s))
      ++crowd[p.y > (f.y.begin + f.y.end) / 2][p.x > (f.x.begin + f.x.end) / 2];
  }
  bool lower = false, right = false;
  for (const bool down : {false, true})
    for (const bool side : {false, true})
      if (crowd[down][side] < crowd[lower][right]) lower = down, right = side;
  Html out;
  double y = lower ? f.y.begin - 13 * rows + 5 : f.y.end + 14;
  for (const ChartSeries& s : series) {
    if (s.name.empty()) continue;
    out += svg_text(right ? f.x.end - 8 : f.x.begin + 8, y,
                    fmt::format("key c{}{}", s.colour % kSvgColours, right ? " end" : ""), s.name);
    y += 13;
  }
  return out;
}

}  // namespace

std::vector<double> smoothed(std::span<const double> values, std::size_t reach) {
  std::vector<double> out;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t side = std::min({reach, i, values.size() - 1 - i});
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t k = i - side; k <= i + side; ++k)
      if (std::isfinite(values[k])) sum += values[k], ++count;
    out.push_back(count > 0 ? sum / static_cast<double>(count) : values[i]);
  }
  return out;
}

Html svg_chart(const ChartOptions& options, std::span<const ChartSeries> series) {
  for (const ChartSeries& s : series)
    if (s.x.size() != s.y.size() + (s.steps ? 1 : 0))
      fail(ErrorKind::internal, "chart '{}': {} x and {} y values", s.name, s.x.size(), s.y.size());
  const Frame f = make_frame(options, series);
  Html content = axes(options, f);
  for (const bool faint : {true, false})
    for (const ChartSeries& s : series)
      if (s.faint == faint) content += (s.line ? line(f, s) : Html{}) + (s.markers ? markers(f, s) : Html{});
  content += point_labels(f, series);
  if (options.legend) content += chart_legend(f, series);
  return tag("svg",
             {{"viewBox", fmt::format("0 0 {} {}", options.width, options.height)},
              {"role", "img"},
              {"aria-label", options.title},
              {"class", "chart"}},
             content);
}

std::vector<double> axis_ticks(double low, double high, bool logarithmic) {
  std::vector<double> ticks;
  const double slack = 1e-9;
  if (logarithmic) {
    const int first = static_cast<int>(std::floor(std::log10(low))),
              last = static_cast<int>(std::ceil(std::log10(high)));
    const int step = 1 + (last - first) / 9;  // labels of more than nine decades run into each other
    for (const bool fine : {false, true}) {
      ticks.clear();
      for (int e = first; e <= last; e += step)
        for (const double factor : {1.0, 2.0, 5.0}) {
          const double tick = factor * std::pow(10.0, e);
          if ((factor == 1 || fine) && tick >= low * (1 - slack) && tick <= high * (1 + slack))
            ticks.push_back(tick);
        }
      if (ticks.size() >= 3) return ticks;
    }
    ticks.clear();
  }
  const double raw = (high - low) / 6, power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = 10 * power;
  for (const double factor : {5.0, 2.0, 1.0})
    if (factor * power >= raw * (1 - slack)) step = factor * power;
  const double first = std::ceil(low / step - slack);
  for (double i = first; i * step <= high + slack * step; ++i) ticks.push_back(i * step + 0.0);
  return ticks;
}

std::string tick_text(double value) {
  if (std::abs(value) >= 999.5e6) return fmt::format("{:.4g}G", value / 1e9);
  if (std::abs(value) >= 999.5e3) return fmt::format("{:.4g}M", value / 1e6);
  if (std::abs(value) >= 999.5) return fmt::format("{:.4g}K", value / 1e3);
  if (value != 0 && std::abs(value) < 1e-3) {  // "1e-4": four digits after zeros do not fit beside the axis
    const int power = static_cast<int>(std::floor(std::log10(std::abs(value)) + 1e-9));
    return fmt::format("{:.3g}e{}", value / std::pow(10.0, power), power);
  }
  return fmt::format("{:.4g}", value);
}

}  // namespace ubs
