// SPDX-License-Identifier: Apache-2.0
#include "host/report/plot.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "host/base/error.hpp"

namespace ubs {
namespace {

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kTextScale = 0.45, kTitleScale = 0.55;
constexpr int kLeft = 78, kRight = 20, kTop = 40, kBottom = 58;
const cv::Scalar kBlack(20, 20, 20), kGrid(225, 225, 225), kFrame(90, 90, 90), kWhite(255, 255, 255);

// Okabe and Ito: distinct for colour-blind readers too.
const std::array<cv::Scalar, 7> kColours{
    cv::Scalar(0, 114, 178), cv::Scalar(213, 94, 0),   cv::Scalar(0, 158, 115), cv::Scalar(204, 121, 167),
    cv::Scalar(230, 159, 0), cv::Scalar(86, 180, 233), cv::Scalar(90, 90, 90)};

struct PlotAxis {
  double low = 0, high = 1;  // in axis units: log10 on logarithmic axes
  bool logarithmic = false;
  int begin = 0, end = 1;  // pixels

  bool shows(double value) const { return std::isfinite(value) && (!logarithmic || value > 0); }
  double unit(double value) const { return logarithmic ? std::log10(value) : value; }
  double value(double unit) const { return logarithmic ? std::pow(10.0, unit) : unit; }
  double pixel(double value) const { return begin + (unit(value) - low) / (high - low) * (end - begin); }
};

cv::Scalar colour_of(const PlotSeries& series, std::size_t position) {
  return kColours[(series.colour < 0 ? position : static_cast<std::size_t>(series.colour)) % kColours.size()];
}

cv::Size text_size(const std::string& text, double scale) {
  int baseline = 0;
  return cv::getTextSize(text, kFont, scale, 1, &baseline);
}

// `anchor` is the point of the text at the fraction (ax, ay) of its size from the top left.
void put_text(cv::Mat& image, const std::string& text, cv::Point anchor, double ax, double ay,
              double scale = kTextScale) {
  const cv::Size size = text_size(text, scale);
  const cv::Point origin(anchor.x - static_cast<int>(ax * size.width),
                         anchor.y + static_cast<int>((1 - ay) * size.height));
  cv::putText(image, text, origin, kFont, scale, kBlack, 1, cv::LINE_AA);
}

// Around `centre` where there is room, else nearer to the middle, else smaller.
void put_title(cv::Mat& image, const std::string& title, int centre) {
  constexpr int kMargin = 8;
  const int room = image.cols - 2 * kMargin, wanted = text_size(title, kTitleScale).width;
  const double scale = kTitleScale * std::min(1.0, static_cast<double>(room) / std::max(wanted, 1));
  const int half = std::min(wanted, room) / 2;
  put_text(image, title, {std::clamp(centre, half + kMargin, image.cols - half - kMargin), 14}, 0.5, 0,
           scale);
}

void put_vertical_text(cv::Mat& image, const std::string& text, cv::Point centre) {
  const cv::Size size = text_size(text, kTextScale);
  cv::Mat horizontal(size.height + 10, size.width + 2, CV_8UC3, kWhite), vertical;
  cv::putText(horizontal, text, {1, size.height + 2}, kFont, kTextScale, kBlack, 1, cv::LINE_AA);
  cv::rotate(horizontal, vertical, cv::ROTATE_90_COUNTERCLOCKWISE);
  const cv::Rect place(centre.x - vertical.cols / 2, centre.y - vertical.rows / 2, vertical.cols,
                       vertical.rows);
  const cv::Rect visible = place & cv::Rect(0, 0, image.cols, image.rows);
  if (!visible.empty()) vertical(visible - place.tl()).copyTo(image(visible));
}

PlotAxis make_axis(std::span<const PlotSeries> series, bool is_x, const PlotOptions& options) {
  PlotAxis axis;
  axis.logarithmic = is_x ? options.log_x : options.log_y;
  const PlotAxis other{.logarithmic = is_x ? options.log_y : options.log_x};
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const PlotSeries& s : series)
    for (std::size_t i = 0; i < s.x.size(); ++i) {
      const double here = is_x ? s.x[i] : s.y[i], there = is_x ? s.y[i] : s.x[i];
      if (!axis.shows(here) || !other.shows(there)) continue;
      low = std::min(low, axis.unit(here));
      high = std::max(high, axis.unit(here));
    }
  if (low > high) return axis;
  if (!is_x && options.from_zero && !axis.logarithmic) low = std::min(low, 0.0);
  double margin = 0.04 * (high - low);
  if (margin == 0) margin = axis.logarithmic ? 0.3 : std::max(0.5, 0.1 * std::abs(low));
  axis.low = low == 0 && options.from_zero && !is_x ? 0 : low - margin;
  axis.high = high + margin;
  return axis;
}

void draw_grid(cv::Mat& image, const PlotAxis& x, const PlotAxis& y, const PlotOptions& options) {
  for (const double tick : axis_ticks(x.value(x.low), x.value(x.high), x.logarithmic)) {
    const int at = static_cast<int>(std::lround(x.pixel(tick)));
    cv::line(image, {at, y.begin}, {at, y.end}, kGrid);
    put_text(image, tick_text(tick), {at, y.begin + 8}, 0.5, 0);
  }
  for (const double tick : axis_ticks(y.value(y.low), y.value(y.high), y.logarithmic)) {
    const int at = static_cast<int>(std::lround(y.pixel(tick)));
    cv::line(image, {x.begin, at}, {x.end, at}, kGrid);
    put_text(image, tick_text(tick), {x.begin - 8, at}, 1, 0.5);
  }
  cv::rectangle(image, {x.begin, y.end}, {x.end, y.begin}, kFrame);
  put_title(image, options.title, (x.begin + x.end) / 2);
  put_text(image, options.x_label, {(x.begin + x.end) / 2, image.rows - 20}, 0.5, 0);
  put_vertical_text(image, options.y_label, {14, (y.begin + y.end) / 2});
}

void draw_segment(cv::Mat& image, cv::Point2d a, cv::Point2d b, const cv::Scalar& colour, bool dashed) {
  if (!dashed) return cv::line(image, a, b, colour, 2, cv::LINE_AA);
  const double length = std::hypot(b.x - a.x, b.y - a.y);
  for (double at = 0; at < length; at += 11) {
    const double to = std::min(at + 6, length);
    cv::line(image, a + (b - a) * (at / length), a + (b - a) * (to / length), colour, 1, cv::LINE_AA);
  }
}

void draw_marker(cv::Mat& image, cv::Point at, std::size_t kind, const cv::Scalar& colour) {
  switch (kind % 3) {
    case 0:
      cv::circle(image, at, 4, colour, cv::FILLED, cv::LINE_AA);
      break;
    case 1:
      cv::rectangle(image, at - cv::Point(4, 4), at + cv::Point(4, 4), colour, cv::FILLED);
      break;
    default:
      cv::drawMarker(image, at, colour, cv::MARKER_TILTED_CROSS, 9, 2, cv::LINE_AA);
  }
}

std::size_t draw_series(cv::Mat& image, const PlotAxis& x, const PlotAxis& y, const PlotSeries& series,
                        std::size_t index) {
  const cv::Scalar colour = colour_of(series, index);
  std::vector<cv::Point2d> points;
  for (std::size_t i = 0; i < series.x.size(); ++i)
    if (x.shows(series.x[i]) && y.shows(series.y[i]))
      points.emplace_back(x.pixel(series.x[i]), y.pixel(series.y[i]));
  for (std::size_t i = 1; series.line && i < points.size(); ++i)
    draw_segment(image, points[i - 1], points[i], colour, series.dashed);
  for (std::size_t i = 0; series.markers && i < points.size(); ++i)
    draw_marker(image, points[i], index, colour);
  return points.size();
}

// Beside each point, at the first of some places where no label and no marker is yet.
void draw_labels(cv::Mat& image, const PlotAxis& x, const PlotAxis& y, std::span<const PlotSeries> series) {
  std::vector<cv::Rect> taken;
  std::vector<std::pair<cv::Point, std::string>> labels;
  for (const PlotSeries& s : series)
    for (std::size_t i = 0; i < s.labels.size(); ++i) {
      if (!x.shows(s.x[i]) || !y.shows(s.y[i])) continue;
      const cv::Point at(static_cast<int>(x.pixel(s.x[i])), static_cast<int>(y.pixel(s.y[i])));
      taken.emplace_back(at - cv::Point(4, 4), cv::Size(9, 9));
      labels.emplace_back(at, s.labels[i]);
    }
  const cv::Point directions[] = {{1, -1}, {1, 1}, {-1, -1}, {-1, 1}, {0, -1}, {0, 1}};
  for (const auto& [at, text] : labels) {
    const cv::Size size = text_size(text, kTextScale);
    cv::Rect place;
    for (const int distance : {7, 18, 32, 46}) {
      bool free = false;
      for (const cv::Point& d : directions) {
        const cv::Point centre = at + cv::Point(d.x * (size.width / 2 + 7), d.y * distance);
        place = cv::Rect(centre - cv::Point(size.width / 2, size.height / 2), size);
        free = std::ranges::none_of(taken, [&](const cv::Rect& r) { return (r & place).area() > 0; });
        if (free) break;
      }
      if (free) break;
    }
    taken.push_back(place);
    if (std::abs(place.y + place.height / 2 - at.y) > 12)
      cv::line(image, at, cv::Point(place.x + place.width / 2, place.y + place.height / 2), kGrid, 1,
               cv::LINE_AA);
    put_text(image, text, {place.x + place.width / 2, place.y + place.height / 2}, 0.5, 0.5);
  }
}

// In the upper corner where fewer points lie.
void draw_legend(cv::Mat& image, const PlotAxis& x, const PlotAxis& y, std::span<const PlotSeries> series) {
  int width = 0, rows = 0;
  for (const PlotSeries& s : series) {
    if (s.name.empty()) continue;
    width = std::max(width, text_size(s.name, kTextScale).width);
    ++rows;
  }
  if (rows == 0) return;
  const cv::Size size(width + 50, 18 * rows + 8);
  const auto crowd = [&](int left, int top) {
    std::size_t count = 0;
    for (const PlotSeries& s : series)
      for (std::size_t i = 0; i < s.x.size(); ++i)
        if (x.shows(s.x[i]) && y.shows(s.y[i]) &&
            cv::Rect(left, top, size.width, size.height)
                .contains(cv::Point(static_cast<int>(x.pixel(s.x[i])), static_cast<int>(y.pixel(s.y[i])))))
          ++count;
    return count;
  };
  const int lefts[] = {x.begin + 8, x.end - 8 - size.width}, tops[] = {y.end + 8, y.begin - 8 - size.height};
  cv::Point corner(lefts[0], tops[0]);
  for (const int top : tops)
    for (const int left : lefts)
      if (crowd(left, top) < crowd(corner.x, corner.y)) corner = {left, top};
  cv::rectangle(image, cv::Rect(corner, size), kWhite, cv::FILLED);
  cv::rectangle(image, cv::Rect(corner, size), kGrid);
  int row = corner.y + 13;
  for (std::size_t i = 0; i < series.size(); ++i) {
    if (series[i].name.empty()) continue;
    const cv::Scalar colour = colour_of(series[i], i);
    if (series[i].line)
      draw_segment(image, cv::Point(corner.x + 8, row), cv::Point(corner.x + 34, row), colour,
                   series[i].dashed);
    if (series[i].markers) draw_marker(image, {corner.x + 21, row}, i, colour);
    put_text(image, series[i].name, {corner.x + 42, row}, 0, 0.5);
    row += 18;
  }
}

Image8 image_of(const cv::Mat& mat) {
  Image8 image{mat.cols, mat.rows, {}};
  image.rgb.assign(mat.datastart, mat.dataend);  // drawn in RGB from the start
  return image;
}

}  // namespace

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

Image8 draw_plot(const PlotOptions& options, std::span<const PlotSeries> series) {
  for (const PlotSeries& s : series)
    if (s.x.size() != s.y.size())
      fail(ErrorKind::internal, "plot '{}': {} x and {} y values", s.name, s.x.size(), s.y.size());
  for (const PlotSeries& s : series)
    if (!s.labels.empty() && s.labels.size() != s.x.size())
      fail(ErrorKind::internal, "plot '{}': {} points and {} labels", s.name, s.x.size(), s.labels.size());
  cv::Mat image(options.height, options.width, CV_8UC3, kWhite);
  PlotAxis x = make_axis(series, true, options), y = make_axis(series, false, options);
  x.begin = kLeft;
  x.end = options.width - kRight;
  y.begin = options.height - kBottom;
  y.end = kTop;
  draw_grid(image, x, y, options);
  std::size_t points = 0;
  for (std::size_t i = 0; i < series.size(); ++i) points += draw_series(image, x, y, series[i], i);
  draw_labels(image, x, y, series);
  if (points == 0) put_text(image, "no data", {(x.begin + x.end) / 2, (y.begin + y.end) / 2}, 0.5, 0.5);
  draw_legend(image, x, y, series);
  return image_of(image);
}

Image8 tile_images(std::span<const Image8> images, int columns) {
  if (images.empty() || columns < 1) fail(ErrorKind::internal, "no images to put side by side");
  const int across = std::min(columns, static_cast<int>(images.size()));
  const int down = (static_cast<int>(images.size()) + across - 1) / across;
  const int width = images[0].width, height = images[0].height;
  cv::Mat sheet(down * height, across * width, CV_8UC3, kWhite);
  for (std::size_t i = 0; i < images.size(); ++i) {
    if (images[i].width != width || images[i].height != height)
      fail(ErrorKind::internal, "images of different sizes cannot be put side by side");
    const cv::Mat image(height, width, CV_8UC3, const_cast<std::uint8_t*>(images[i].rgb.data()));
    const int n = static_cast<int>(i);
    image.copyTo(sheet(cv::Rect(n % across * width, n / across * height, width, height)));
  }
  return image_of(sheet);
}

}  // namespace ubs
