//! Timestamps (RFC 3339, UTC, whole seconds) and durations as text.
//!
//! Days are converted to dates by Howard Hinnant's `civil_from_days` (howardhinnant.github.io/date_algorithms.html).

use std::time::{SystemTime, UNIX_EPOCH};

use crate::error::{Error, Result};

const SECONDS_PER_DAY: u64 = 86_400;

/// Current time, s since 1970.
pub fn now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())
}

/// Formats a timestamp: `2026-11-24T20:00:00Z`.
pub fn format_time(moment: u64) -> String {
    let (day, second) = ((moment / SECONDS_PER_DAY) as i64, moment % SECONDS_PER_DAY);
    let z = day + 719_468;
    let (era, of_era) = (z.div_euclid(146_097), z.rem_euclid(146_097));
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * of_year + 2) / 153;
    let (d, m) =
        (of_year - (153 * shifted + 2) / 5 + 1, if shifted < 10 { shifted + 3 } else { shifted - 9 });
    let y = year_of_era + era * 400 + i64::from(m <= 2);
    format!("{y:04}-{m:02}-{d:02}T{:02}:{:02}:{:02}Z", second / 3600, second / 60 % 60, second % 60)
}

/// Parses a timestamp in that format.
pub fn parse_time(field: &str, text: &str) -> Result<u64> {
    let refuse = || Error::input(field, format!("{text:?}"), "a time such as 2026-12-31T00:00:00Z");
    let number = |from: usize, to: usize| text.get(from..to).and_then(|t| t.parse::<u64>().ok());
    let parts = [(0, 4), (5, 7), (8, 10), (11, 13), (14, 16), (17, 19)].map(|(a, b)| number(a, b));
    let [Some(y), Some(m), Some(d), Some(hour), Some(minute), Some(second)] = parts else {
        return Err(refuse());
    };
    if !(1970..=9999).contains(&y) || !(1..=12).contains(&m) {
        return Err(refuse());
    }
    let (y, m) = (if m <= 2 { y - 1 } else { y }, m);
    let shifted = if m > 2 { m - 3 } else { m + 9 };
    let of_year = (153 * shifted + 2) / 5 + d.saturating_sub(1);
    let of_era = (y % 400) * 365 + (y % 400) / 4 - (y % 400) / 100 + of_year;
    let days = ((y / 400) * 146_097 + of_era).checked_sub(719_468).ok_or_else(refuse)?;
    let found = days * SECONDS_PER_DAY + hour * 3600 + minute * 60 + second;
    // An invalid date (31 June, hour 25) does not survive the round trip.
    if format_time(found) == text { Ok(found) } else { Err(refuse()) }
}

/// Parses a duration, s: `30d`, `12h`, `15m` or `90s`; `None` for `never`.
pub fn parse_duration(field: &str, text: &str) -> Result<Option<u64>> {
    if text == "never" {
        return Ok(None);
    }
    let of = text.chars().last().and_then(|unit| {
        let each =
            [('d', SECONDS_PER_DAY), ('h', 3600), ('m', 60), ('s', 1)].into_iter().find(|u| u.0 == unit)?.1;
        let count: u64 = text[..text.len() - 1].parse().ok()?;
        count.checked_mul(each).filter(|s| (1..=36_500 * SECONDS_PER_DAY).contains(s))
    });
    let allowed = "a duration such as 30d, 12h, 15m or 90s, up to 36500d; or never";
    of.map(Some).ok_or_else(|| Error::input(field, format!("{text:?}"), allowed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timestamps_round_trip() {
        for (at, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_700_000_000, "2023-11-14T22:13:20Z"),
            (4_102_444_799, "2099-12-31T23:59:59Z"),
        ] {
            assert_eq!(format_time(at), text);
            assert_eq!(parse_time("expires", text).unwrap(), at);
        }
        for day in (0..60_000).step_by(13) {
            assert_eq!(
                parse_time("expires", &format_time(day * SECONDS_PER_DAY + 7)).unwrap(),
                day * SECONDS_PER_DAY + 7
            );
        }
        for bad in
            ["", "2026-02-30T00:00:00Z", "2026-06-31T00:00:00Z", "2026-01-01", "2026-01-01T24:00:00Z", "x"]
        {
            assert!(parse_time("expires", bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn durations_need_a_unit() {
        assert_eq!(parse_duration("--expires", "30d").unwrap(), Some(30 * SECONDS_PER_DAY));
        assert_eq!(parse_duration("--expires", "90s").unwrap(), Some(90));
        assert_eq!(parse_duration("--expires", "never").unwrap(), None);
        for bad in ["", "30", "d", "-1d", "0d", "1y", "99999999999999999999d", "1é"] {
            assert!(parse_duration("--expires", bad).is_err(), "{bad}");
        }
    }
}
