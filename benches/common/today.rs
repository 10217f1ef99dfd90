//! The date.

use std::time::UNIX_EPOCH;

/// The date in UTC, as `2031-05-17`.
pub fn today() -> String {
    let days = UNIX_EPOCH.elapsed().unwrap_or_default().as_secs() / 86_400;
    // Years begin in March here, in which the leap day is the last; 400 of them have 146,097 days.
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let (day, month) = (day - (153 * month + 2) / 5 + 1, if month < 10 { month + 3 } else { month - 9 });
    format!("{:04}-{month:02}-{day:02}", 400 * era + year + u64::from(month <= 2))
}
