//! Comparison of the medial mesh with other methods: ratio of times at the same error, and ratio of errors in the same time.

use crate::{methods::Method, queries::Row};

/// Another method at one of its resolutions, compared with the medial mesh. Ratios above 1 mean that the medial mesh is better.
pub struct Verdict {
    pub rival: &'static str,
    pub parts: f64,
    /// By the median of the errors, and by their 95th percentile.
    pub by: [Ratios; 2],
}

/// Ratios of the other method to the medial mesh.
pub struct Ratios {
    /// Time of the other method over that of a medial mesh with the same error. `None` if the finest medial mesh has a larger error.
    pub faster: Option<f64>,
    /// Error of the other method over that of a medial mesh with the same time. `None` if the coarsest medial mesh takes longer.
    pub nearer: Option<f64>,
}

/// The verdicts on all resolutions of the methods with another shape, or with another scheme for the time of impact.
pub fn verdicts(rows: &[Row]) -> Vec<Verdict> {
    let errors: [fn(&Row) -> f64; 2] = [|row| row.hit_error_median_percent, |row| row.hit_error_p95_percent];
    let rivals = [Method::Alternating, Method::Spheres, Method::Decomposition, Method::Hull, Method::TriMesh];
    let own = errors.map(|error| curve(rows, Method::Medial.name(), error));
    let of_row = |row: &Row| Verdict {
        rival: row.method,
        parts: row.parts,
        by: [0, 1].map(|i: usize| {
            let [time, error] = [row.microseconds, errors[i](row)];
            Ratios {
                faster: along(&own[i], 1, error).map(|own| time / own),
                nearer: along(&own[i], 0, time).map(|own| error / own),
            }
        }),
    };
    rivals.iter().flat_map(|rival| rows.iter().filter(|row| row.method == rival.name())).map(of_row).collect()
}

/// Time and error of each resolution, the coarsest first. Resolutions that are not slower and more exact than the one before are left out.
fn curve(rows: &[Row], method: &str, error: fn(&Row) -> f64) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = Vec::new();
    for row in rows.iter().filter(|row| row.method == method) {
        let point = [row.microseconds, error(row)];
        if points.last().is_none_or(|last| point[0] > last[0] && point[1] < last[1]) {
            points.push(point);
        }
    }
    points
}

/// The other coordinate of the curve where coordinate `axis` has a value, on straight lines between logarithms. The coarsest point is used for errors
/// above its own, and the finest point for times above its own.
fn along(points: &[[f64; 2]], axis: usize, value: f64) -> Option<f64> {
    let (first, last) = (points.first()?, points.last()?);
    match axis {
        0 if value < first[0] => return None,
        0 if value >= last[0] => return Some(last[1]),
        1 if value < last[1] => return None,
        1 if value >= first[1] => return Some(first[0]),
        _ => {}
    }
    points.windows(2).find_map(|pair| {
        let [from, to] = [pair[0].map(f64::ln), pair[1].map(f64::ln)];
        let part = (value.ln() - from[axis]) / (to[axis] - from[axis]);
        (0.0..=1.0).contains(&part).then(|| (from[1 - axis] + part * (to[1 - axis] - from[1 - axis])).exp())
    })
}
