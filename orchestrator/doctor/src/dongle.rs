//! Crazyradio, the USB dongle of a Crazyflie: driver, device and permission.

use super::check::Check;
use super::host::HostFacts;
use super::needs::Needs;

const NAME: &str = "Crazyradio dongle";
/// Folder of the USB devices in sysfs, and identity of a dongle.
const DEVICES: &str = "sys/bus/usb/devices";
const IDENTITY: [(&str, &str); 2] = [("idVendor", "1915"), ("idProduct", "7777")];

const BUILD: &str = "cargo build --release --features crazyradio; an installed program: cargo install --path orchestrator \
                     --features crazyradio";
const UDEV_RULE: &str = "echo 'SUBSYSTEM==\"usb\", ATTRS{idVendor}==\"1915\", ATTRS{idProduct}==\"7777\", MODE=\"0660\", \
                         GROUP=\"plugdev\"' | sudo tee /etc/udev/rules.d/99-crazyradio.rules; sudo usermod -aG plugdev $USER; \
                         then log in again and plug it in again";

/// Checks the dongle that the scenario states, or without a scenario those that are plugged in; `None` without either. `has_driver`
/// states whether this program has the driver.
#[must_use]
pub fn check(host: &HostFacts, needs: &Needs, has_driver: bool) -> Option<Check> {
    let nodes = nodes(host);
    let wanted = match needs.dongle {
        Some(index) => index,
        None if needs.has_scenario || nodes.is_empty() => return None,
        None => 0,
    };
    // Only a flight fails without it.
    let missing = |figure: String, fix: &str| Check::refused(needs.dongle.is_some(), NAME, figure, fix);
    let closed = nodes.iter().find(|node| !host.may_open(node));
    Some(if !has_driver {
        missing("this program was built without its driver".to_owned(), BUILD)
    } else if nodes.len() <= wanted {
        let figure = format!(
            "{} plugged in, and the scenario's has the index {wanted}",
            nodes.len()
        );
        missing(
            figure,
            "plug it in, or change `rc_output.transmitter.uri`; `lsusb -d 1915:7777` lists them",
        )
    } else if let Some(node) = closed {
        missing(format!("this user may not open /{node}"), UDEV_RULE)
    } else {
        Check::green(NAME, format!("{} plugged in", nodes.len()))
    })
}

/// Returns the device files of the dongles that are plugged in, without the leading slash.
fn nodes(host: &HostFacts) -> Vec<String> {
    let node = |device: String| {
        let read = |file: &str| host.text(&format!("{DEVICES}/{device}/{file}"));
        let is_dongle = |(file, value): (&str, &str)| read(file).as_deref() == Some(value);
        if !IDENTITY.into_iter().all(is_dongle) {
            return None;
        }
        let number = |file| read(file)?.parse::<u32>().ok();
        let (bus, device) = (number("busnum")?, number("devnum")?);
        Some(format!("dev/bus/usb/{bus:03}/{device:03}"))
    };
    host.names(DEVICES).into_iter().filter_map(node).collect()
}

#[cfg(test)]
mod tests {
    use super::super::CheckOutcome::{Green, Red, Yellow};
    use super::super::host::fake;
    use super::*;

    const PLUGGED_IN: [(&str, &str); 5] = [
        ("sys/bus/usb/devices/1-2/idVendor", "1915\n"),
        ("sys/bus/usb/devices/1-2/idProduct", "7777\n"),
        ("sys/bus/usb/devices/1-2/busnum", "1\n"),
        ("sys/bus/usb/devices/1-2/devnum", "14\n"),
        ("sys/bus/usb/devices/1-3/idVendor", "0403\n"),
    ];
    const NODE: (&str, &str) = ("dev/bus/usb/001/014", "");

    /// Verdict and figure without a scenario, and with one that states the first dongle.
    fn found(files: &[(&str, &str)], has_driver: bool) -> [Option<Check>; 2] {
        let (_folder, host) = fake(files, None);
        let stated = Needs {
            has_scenario: true,
            dongle: Some(0),
            ..Needs::ordinary()
        };
        [Needs::ordinary(), stated].map(|needs| check(&host, &needs, has_driver))
    }

    #[test]
    fn a_dongle_needs_driver_device_and_permission() {
        let all = [&PLUGGED_IN[..], &[NODE]].concat();
        for (files, has_driver, verdicts, figure, fix) in [
            (&all[..], true, [Some(Green), Some(Green)], "1 plugged in", ""),
            (
                &all,
                false,
                [Some(Yellow), Some(Red)],
                "without its driver",
                "--features crazyradio",
            ),
            (
                &PLUGGED_IN,
                true,
                [Some(Yellow), Some(Red)],
                "may not open /dev/bus/usb/001/014",
                "99-crazyradio.rules",
            ),
            (
                &PLUGGED_IN[4..],
                true,
                [None, Some(Red)],
                "0 plugged in",
                "plug it in",
            ),
        ] {
            let checks = found(files, has_driver);
            let seen = checks
                .each_ref()
                .map(|check| check.as_ref().map(|check| check.verdict));
            assert_eq!(seen, verdicts, "{figure}");
            for check in checks.into_iter().flatten() {
                assert!(check.figure.contains(figure), "{check:?}");
                assert!(check.fix.unwrap_or_default().contains(fix), "{figure}");
            }
        }
    }

    #[test]
    fn a_scenario_without_a_dongle_needs_none() {
        let (_folder, host) = fake(&PLUGGED_IN, None);
        let needs = Needs {
            has_scenario: true,
            ..Needs::ordinary()
        };
        assert_eq!(check(&host, &needs, false), None);
    }
}
