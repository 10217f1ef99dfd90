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

/// A table that was read from CSV.
pub struct Table {
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// Reads the text of [`csv`].
    pub fn new(text: &str) -> Self {
        let mut rows = text.lines().map(fields);
        Self { header: rows.next().unwrap_or_default(), rows: rows.collect() }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// If the file cannot be read. The message names it.
    pub fn read(path: &Path) -> Result<Self, String> {
        fs::read_to_string(path).map(|text| Self::new(&text)).map_err(|error| format!("{}: {error}", path.display()))
    }

    pub fn rows(&self) -> impl Iterator<Item = &[String]> {
        self.rows.iter().map(Vec::as_slice)
    }

    /// The value of a row in a column, without quotes. `None` if there is no such column.
    pub fn get<'a>(&self, row: &'a [String], column: &str) -> Option<&'a str> {
        row.get(self.header.iter().position(|name| name == column)?).map(String::as_str)
    }

    /// All values of a column.
    pub fn column(&self, name: &str) -> impl Iterator<Item = &str> {
        self.rows().filter_map(move |row| self.get(row, name))
    }
}

/// The fields of a line. Commas within quotes do not separate fields.
fn fields(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut is_quoted = false;
    for letter in line.chars() {
        match letter {
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => fields.push(String::new()),
            letter => fields.last_mut().into_iter().for_each(|field| field.push(letter)),
        }
    }
    fields
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

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize)]
    struct Row {
        name: &'static str,
        value: f64,
    }

    #[test]
    fn a_table_reads_the_text_that_was_written() {
        let rows = [Row { name: "one, two", value: 0.25 }, Row { name: "", value: -3.0 }];
        let table = Table::new(&csv(&rows));
        assert_eq!(table.column("name").collect::<Vec<_>>(), ["one, two", ""]);
        assert_eq!(table.column("value").collect::<Vec<_>>(), ["0.25", "-3.0"]);
        assert_eq!(table.column("other").count(), 0);
    }
}
