//! The line of the laboratory's devices.

use ratatui::style::Stylize;
use ratatui::text::Span;

use crate::words::{cut, short_time};
use run_client::Snapshot;
use run_client::snapshot::{BatterySnapshot, CamerasSnapshot, LinkSnapshot, ReceiversSnapshot};

/// Returns the state of cameras, receivers and radio link, failures first, because a narrow terminal cuts off the end. `None` in a
/// flight without them.
pub(super) fn line(snapshot: &Snapshot, width: u16) -> Option<Vec<Span<'static>>> {
    let is_there = snapshot.cameras.is_some()
        || snapshot.receivers.is_some()
        || snapshot.radio_link.is_some()
        || snapshot.battery.is_some();
    let (mut troubles, mut figures) = (Vec::new(), Vec::new());
    if let Some(cameras) = &snapshot.cameras {
        troubles.extend(cameras.trouble.clone());
        figures.push(Span::raw(in_words(cameras)));
        // A failure already contains its reason.
        let refused = cameras.refused.iter().filter(|_| cameras.trouble.is_none());
        figures.extend(refused.map(|reason| Span::raw(cut(reason, width.into())).yellow()));
    }
    if let Some(receivers) = &snapshot.receivers {
        troubles.extend(receivers.trouble.clone());
        figures.push(Span::raw(samples(receivers)));
        let refused = receivers.refused.iter().filter(|_| receivers.trouble.is_none());
        figures.extend(refused.map(|reason| Span::raw(cut(reason, width.into())).yellow()));
    }
    if let Some(link) = &snapshot.radio_link {
        troubles.extend(link.trouble.clone());
        figures.push(Span::raw(frames(link)));
    }
    if let Some(battery) = &snapshot.battery {
        troubles.extend(battery.trouble.clone());
        let span = Span::raw(volts(battery));
        figures.push(if battery.trouble.is_some() {
            span.red()
        } else {
            span
        });
    }
    let troubles = troubles
        .into_iter()
        .map(|trouble: String| Span::raw(cut(&trouble, width.into())).red());
    is_there.then(|| troubles.chain(figures).collect())
}

fn in_words(cameras: &CamerasSnapshot) -> String {
    format!(
        "cameras {:.1} Hz, {} old ±{}, {} of {} believed",
        cameras.rate,
        short_time(cameras.latency),
        short_time(cameras.jitter),
        cameras.believed,
        cameras.frames
    )
}

fn samples(receivers: &ReceiversSnapshot) -> String {
    let rates = ReceiversSnapshot::SENSORS.iter().zip(receivers.rates);
    let rates: Vec<_> = rates
        .map(|(sensor, rate)| format!("{sensor} {rate:.1}"))
        .collect();
    format!("receivers, Hz: {}", rates.join(", "))
}

fn volts(battery: &BatterySnapshot) -> String {
    let age = battery
        .age
        .map_or("modelled".to_owned(), |age| format!("{age:.1}s old"));
    format!("battery {:.2} V, {age}", battery.voltage)
}

fn frames(link: &LinkSnapshot) -> String {
    format!("link {} sent, {} lost", link.sent, link.lost)
}
