//! Line plots as inline SVG: no script, no file beside the page.

use std::fmt::Write;

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the key.
    pub name: String,
    /// Points in the plot's units, in drawing order.
    pub points: Vec<(f64, f64)>,
}

/// A plot.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// Above the plot.
    pub title: String,
    /// Quantity and unit.
    pub x_label: String,
    /// Quantity and unit.
    pub y_label: String,
    /// Logarithmic axes, x then y. Points at or below zero are left out on a logarithmic axis.
    pub logarithmic: [bool; 2],
    /// The curves.
    pub series: Vec<Series>,
}

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 300.0;
const MARGIN: [f64; 4] = [64.0, 12.0, 46.0, 34.0];
const COLORS: [&str; 8] = [
    "#3366cc", "#dc5a1e", "#1e9b5a", "#8e44ad", "#b8860b", "#0e9aa7", "#c2185b", "#607d8b",
];

impl Plot {
    /// The SVG element; empty where there is no point to draw.
    pub fn svg(&self) -> String {
        let usable = |&(x, y): &(f64, f64)| {
            x.is_finite()
                && y.is_finite()
                && (!self.logarithmic[0] || x > 0.0)
                && (!self.logarithmic[1] || y > 0.0)
        };
        let points: Vec<_> = self
            .series
            .iter()
            .flat_map(|series| &series.points)
            .copied()
            .filter(usable)
            .collect();
        if points.is_empty() {
            return String::new();
        }
        let x_axis = Axis::over(points.iter().map(|point| point.0), self.logarithmic[0]);
        let y_axis = Axis::over(points.iter().map(|point| point.1), self.logarithmic[1]);
        let place = |&(x, y): &(f64, f64)| {
            let [left, right, bottom, top] = MARGIN;
            let across = left + x_axis.share(x) * (WIDTH - left - right);
            (
                across,
                HEIGHT - bottom - y_axis.share(y) * (HEIGHT - bottom - top),
            )
        };
        let mut svg = format!(
            "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\"><text class=\"t\" x=\"{}\" y=\"18\">{}</text>",
            MARGIN[0],
            escape(&self.title)
        );
        for x in x_axis.ticks() {
            let (across, _) = place(&(x, y_axis.low));
            let _ = write!(
                svg,
                "<path class=\"g\" d=\"M{across:.1} {} V{}\"/>",
                MARGIN[3],
                HEIGHT - MARGIN[2]
            );
            let _ = write!(
                svg,
                "<text class=\"x\" x=\"{across:.1}\" y=\"{}\">{}</text>",
                HEIGHT - MARGIN[2] + 15.0,
                number(x)
            );
        }
        for y in y_axis.ticks() {
            let (_, down) = place(&(x_axis.low, y));
            let _ = write!(
                svg,
                "<path class=\"g\" d=\"M{} {down:.1} H{}\"/>",
                MARGIN[0],
                WIDTH - MARGIN[1]
            );
            let _ = write!(
                svg,
                "<text class=\"y\" x=\"{}\" y=\"{:.1}\">{}</text>",
                MARGIN[0] - 5.0,
                down + 4.0,
                number(y)
            );
        }
        let _ = write!(
            svg,
            "<text class=\"x\" x=\"{}\" y=\"{}\">{}</text>",
            (WIDTH + MARGIN[0]) / 2.0,
            HEIGHT - 10.0,
            escape(&self.x_label)
        );
        let _ = write!(
            svg,
            "<text class=\"x\" transform=\"translate(13 {}) rotate(-90)\">{}</text>",
            HEIGHT / 2.0,
            escape(&self.y_label)
        );
        for (index, series) in self.series.iter().enumerate() {
            let color = COLORS[index % COLORS.len()];
            let path: Vec<_> = series
                .points
                .iter()
                .filter(|point| usable(point))
                .map(place)
                .collect();
            let line: String = path
                .iter()
                .map(|(x, y)| format!("{x:.1},{y:.1} "))
                .collect();
            let _ = write!(
                svg,
                "<polyline fill=\"none\" stroke=\"{color}\" stroke-width=\"1.8\" points=\"{line}\"/>"
            );
            if path.len() <= 40 {
                for (x, y) in &path {
                    let _ = write!(
                        svg,
                        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.6\" fill=\"{color}\"/>"
                    );
                }
            }
        }
        svg.push_str("</svg>");
        for (index, series) in self.series.iter().enumerate() {
            let color = COLORS[index % COLORS.len()];
            let _ = write!(
                svg,
                "<span class=\"k\"><i style=\"background:{color}\"></i>{}</span>",
                escape(&series.name)
            );
        }
        format!("<figure>{svg}</figure>")
    }
}

struct Axis {
    low: f64,
    high: f64,
    logarithmic: bool,
}

impl Axis {
    fn over(values: impl Iterator<Item = f64> + Clone, logarithmic: bool) -> Self {
        let (mut low, mut high) = (
            values.clone().fold(f64::MAX, f64::min),
            values.fold(f64::MIN, f64::max),
        );
        if logarithmic {
            (low, high) = (low / 1.15, high * 1.15);
        } else {
            low = low.min(0.0);
            let room = if high > low {
                (high - low) * 0.05
            } else {
                high.abs().max(1.0)
            };
            high += room;
        }
        Self {
            low,
            high,
            logarithmic,
        }
    }

    fn share(&self, value: f64) -> f64 {
        match self.logarithmic {
            true => (value / self.low).ln() / (self.high / self.low).ln(),
            false => (value - self.low) / (self.high - self.low),
        }
    }

    /// One, two and five times powers of ten; on a wide logarithmic axis powers of ten alone.
    fn ticks(&self) -> Vec<f64> {
        let span = self.high - self.low;
        if self.logarithmic {
            let decades = (self.high / self.low).log10();
            let steps: &[f64] = if decades > 2.5 {
                &[1.0]
            } else {
                &[1.0, 2.0, 5.0]
            };
            let first = self.low.log10().floor() as i32;
            let last = self.high.log10().ceil() as i32;
            let all = (first..=last)
                .flat_map(|power| steps.iter().map(move |step| step * 10f64.powi(power)));
            return all
                .filter(|tick| (self.low..=self.high).contains(tick))
                .collect();
        }
        let power = 10f64.powf((span / 5.0).log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|step| step * power)
            .into_iter()
            .find(|step| span / step <= 6.0)
            .unwrap_or(span);
        let first = (self.low / step).ceil() as i64;
        (first..)
            .map(|index| index as f64 * step)
            .take_while(|tick| *tick <= self.high)
            .collect()
    }
}

/// A number as a reader wants it: three significant digits, powers with k, M and G.
pub fn number(value: f64) -> String {
    let size = value.abs();
    let (scaled, unit) = match size {
        _ if size >= 1e9 => (value / 1e9, "G"),
        _ if size >= 1e6 => (value / 1e6, "M"),
        _ if size >= 1e4 => (value / 1e3, "k"),
        _ => (value, ""),
    };
    let size = scaled.abs();
    let text = match size {
        _ if size == 0.0 => "0".to_owned(),
        _ if size < 1e-3 => return format!("{value:.1e}"),
        _ if size >= 100.0 => format!("{scaled:.0}"),
        _ if size >= 10.0 => format!("{scaled:.1}"),
        _ if size >= 1.0 => format!("{scaled:.2}"),
        _ => format!("{scaled:.3}"),
    };
    let text = if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.')
    } else {
        &text
    };
    format!("{text}{unit}")
}

/// Text that cannot be taken for markup.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        let cases = [
            (0.0, "0"),
            (0.25, "0.25"),
            (1234.0, "1234"),
            (12_345.0, "12.3k"),
            (2.5e6, "2.5M"),
            (1e-5, "1.0e-5"),
            (100.0, "100"),
        ];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn axes_cover_their_points_and_tick_inside() {
        for logarithmic in [false, true] {
            let axis = Axis::over([0.5, 3.0, 700.0].into_iter(), logarithmic);
            let ticks = axis.ticks();
            assert!(
                ticks.len() >= 2
                    && ticks
                        .iter()
                        .all(|tick| (0.0..=1.0).contains(&axis.share(*tick))),
                "{ticks:?}"
            );
        }
        let flat = Plot {
            title: "a<b".into(),
            x_label: String::new(),
            y_label: String::new(),
            logarithmic: [true; 2],
            series: vec![Series {
                name: "one".into(),
                points: vec![(1.0, 0.0)],
            }],
        };
        assert_eq!(flat.svg(), "");
    }
}
