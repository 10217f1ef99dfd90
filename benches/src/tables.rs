//! Tables and provenance of reports.

use std::{fs, path::Path, time::UNIX_EPOCH};

use serde::Serialize;

/// Rows as CSV, below a header with their field names. Text is in quotes.
pub fn csv<T: Serialize>(rows: impl IntoIterator<Item = T>) -> String {
    let mut text = String::new();
    for row in rows {
        let Ok(serde_json::Value::Object(fields)) = serde_json::to_value(row) else { continue };
        if text.is_empty() {
            text += &fields.keys().map(String::as_str).collect::<Vec<_>>().join(",");
            text.push('\n');
        }
        text += &fields.values().map(ToString::to_string).collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    text
}

/// Writes a file.
///
/// # Errors
/// If the file cannot be written. The message names it.
pub fn write(path: &Path, text: &str) -> Result<(), String> {
    fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
}

/// The processor and the operating system.
pub fn machine() -> String {
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let name = model.map_or("a processor of unknown name", |(_, name)| name.trim());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{name}, {threads} threads, {} {}", std::env::consts::ARCH, std::env::consts::OS)
}

/// The date in UTC, as `2031-05-17`.
pub fn today() -> String {
    let days = UNIX_EPOCH.elapsed().unwrap_or_default().as_secs() / 86_400;
    // Years begin in March here, so that the leap day is their last day. 400 years have 146,097 days.
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let (day, month) = (day - (153 * month + 2) / 5 + 1, if month < 10 { month + 3 } else { month - 9 });
    format!("{:04}-{month:02}-{day:02}", 400 * era + year + u64::from(month <= 2))
}
