//! The server's own counters, read before and after, in Prometheus' text format.

use std::collections::BTreeMap;

use serde::Serialize;

/// Why the counters could not be read.
#[derive(Debug, thiserror::Error)]
pub enum MetricsError {
    /// No answer.
    #[error("{url}: expected the server's counters, found {source}")]
    Http {
        /// Where they should be.
        url: String,
        /// What went wrong.
        source: reqwest::Error,
    },
    /// A line that is no sample.
    #[error("{url} line {line}: expected `name{{labels}} number`, found {found:?}")]
    Line {
        /// Where it stands.
        url: String,
        /// Counted from 1.
        line: usize,
        /// The line.
        found: String,
    },
}

/// All samples at one moment.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Snapshot {
    samples: Vec<Sample>,
}

#[derive(Debug, Clone, PartialEq)]
struct Sample {
    name: String,
    labels: BTreeMap<String, String>,
    value: f64,
}

/// What the server counted during the run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ServerFigures {
    /// Requests finished.
    pub requests: u64,
    /// Those of them that were answered with 500 or above.
    pub failures: u64,
    /// Bytes of all bodies.
    pub bytes: u64,
    /// Pages put into answers.
    pub pages_sent: u64,
    /// By route.
    pub routes: BTreeMap<String, RouteFigures>,
}

/// What the server counted of a route.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RouteFigures {
    /// Requests finished.
    pub requests: u64,
    /// Bytes of their bodies.
    pub bytes: u64,
    /// Milliseconds of a request, from its head to the end of its answer, mean.
    pub mean_ms: f64,
}

impl Snapshot {
    /// Reads the counters; `None` for a library folder, which has no server.
    pub(super) async fn read(url: &str) -> Result<Option<Self>, MetricsError> {
        if !url.contains("://") {
            return Ok(None);
        }
        let url = format!("{}/metrics", url.trim_end_matches('/'));
        let text = get(&url).await.map_err(|source| MetricsError::Http {
            url: url.clone(),
            source,
        })?;
        Self::parse(&text, &url).map(Some)
    }

    fn parse(text: &str, url: &str) -> Result<Self, MetricsError> {
        let mut samples = Vec::new();
        for (index, line) in text.lines().enumerate() {
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let sample = Sample::parse(line).ok_or_else(|| MetricsError::Line {
                url: url.to_owned(),
                line: index + 1,
                found: line.to_owned(),
            })?;
            samples.push(sample);
        }
        Ok(Self { samples })
    }

    /// What was counted between the two.
    pub(super) fn since(&self, before: &Self) -> ServerFigures {
        let mut figures = ServerFigures::default();
        let mut secs: BTreeMap<String, f64> = BTreeMap::new();
        for sample in &self.samples {
            let same = |other: &&Sample| other.name == sample.name && other.labels == sample.labels;
            let grown = sample.value
                - before
                    .samples
                    .iter()
                    .find(same)
                    .map_or(0.0, |other| other.value);
            let label = |name: &str| sample.labels.get(name).cloned().unwrap_or_default();
            let route = label("route");
            match sample.name.as_str() {
                "lodestream_requests_total" => {
                    figures.requests += grown as u64;
                    if label("status").starts_with('5') {
                        figures.failures += grown as u64;
                    }
                    figures.routes.entry(route).or_default().requests += grown as u64;
                }
                "lodestream_response_bytes_total" => {
                    figures.bytes += grown as u64;
                    figures.routes.entry(route).or_default().bytes += grown as u64;
                }
                "lodestream_request_seconds_sum" => *secs.entry(route).or_default() += grown,
                "lodestream_pages_sent_total" => figures.pages_sent += grown as u64,
                _ => {}
            }
        }
        figures.routes.retain(|_, counted| counted.requests > 0);
        for (route, counted) in &mut figures.routes {
            let secs = secs.get(route).copied().unwrap_or(0.0);
            counted.mean_ms = 1e3 * secs / counted.requests as f64;
        }
        figures
    }
}

impl Sample {
    /// `name value` or `name{label="text",…} value`; the server's labels hold neither quotes nor commas.
    fn parse(line: &str) -> Option<Self> {
        let (key, value) = line.rsplit_once(' ')?;
        let (name, labels) = match key.split_once('{') {
            None => (key, ""),
            Some((name, labels)) => (name, labels.strip_suffix('}')?),
        };
        let pairs = labels.split(',').filter(|pair| !pair.is_empty());
        let pair = |pair: &str| {
            let (name, quoted) = pair.split_once('=')?;
            let text = quoted.strip_prefix('"')?.strip_suffix('"')?;
            Some((name.to_owned(), text.to_owned()))
        };
        Some(Self {
            name: name.to_owned(),
            labels: pairs.map(pair).collect::<Option<_>>()?,
            value: value.parse().ok()?,
        })
    }
}

async fn get(url: &str) -> Result<String, reqwest::Error> {
    let client = reqwest::Client::builder().build()?;
    client
        .get(url)
        .send()
        .await?
        .error_for_status()?
        .text()
        .await
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "# HELP lodestream_requests_total Requests.\n\
        lodestream_requests_total{route=\"/v1/pages\",status=\"200\"} 10\n\
        lodestream_requests_total{route=\"/v1/pages\",status=\"503\"} 2\n\
        lodestream_requests_total{route=\"none\",status=\"404\"} 4\n\
        lodestream_response_bytes_total{route=\"/v1/pages\"} 4096\n\
        lodestream_request_seconds_bucket{route=\"/v1/pages\",le=\"+Inf\"} 12\n\
        lodestream_request_seconds_sum{route=\"/v1/pages\"} 0.5\n\
        lodestream_pages_sent_total 30\n\nlodestream_viewers 2\n";

    #[test]
    fn what_grew_between_two_snapshots() -> Result<(), MetricsError> {
        let after = Snapshot::parse(TEXT, "u")?;
        let before = "lodestream_requests_total{route=\"/v1/pages\",status=\"200\"} 2\n\
            lodestream_requests_total{route=\"none\",status=\"404\"} 4\nlodestream_pages_sent_total 10\n";
        let figures = after.since(&Snapshot::parse(before, "u")?);
        assert_eq!(
            (figures.requests, figures.failures, figures.pages_sent),
            (10, 2, 20)
        );
        let route = RouteFigures {
            requests: 10,
            bytes: 4096,
            mean_ms: 50.0,
        };
        assert_eq!(
            figures.routes,
            BTreeMap::from([("/v1/pages".to_owned(), route)])
        );
        Ok(())
    }

    #[test]
    fn a_line_that_is_no_sample_is_named() {
        for (text, line) in [
            ("a 1\nb", "line 2"),
            ("a{x=1} 2", "line 1"),
            ("a{x=\"1\" 2", "line 1"),
            ("a one", "line 1"),
        ] {
            let error = Snapshot::parse(text, "u")
                .map(|_| ())
                .map_err(|error| error.to_string());
            assert!(
                error.as_ref().is_err_and(|error| error.contains(line)),
                "{error:?}"
            );
        }
    }
}
