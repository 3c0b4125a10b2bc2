//! The carrier of frames, as a file states it.

use scenario::{DsmProtocol, RadioProtocol};

use super::*;

const TRANSMITTER: &str = r#"
[rc_output.transmitter]
device = "/dev/serial/by-id/usb-radio"
order = "TAER"
arming_channel = 5
switch = [{ channel = 6, travel = 1.0 }]

[rc_output.transmitter.multi]
dsm = "dsm2_fast"
"#;

fn plugged_in() -> String {
    with(
        LABORATORY,
        "resolution = 12\n",
        "resolution = 12\nlink = \"multi\"\n",
    ) + TRANSMITTER
}

#[test]
fn a_transmitter_is_read_as_it_is_written() {
    let link = load_text(&plugged_in(), &[]).unwrap().rc_output.unwrap();
    assert_eq!(link.link, RadioProtocol::Multi);
    let transmitter = link.transmitter.unwrap();
    assert_eq!(transmitter.device.as_deref(), Some("/dev/serial/by-id/usb-radio"));
    assert_eq!(
        (transmitter.order.as_str(), transmitter.switch[0].channel),
        ("TAER", 6)
    );
    assert_eq!(transmitter.multi.unwrap().dsm, DsmProtocol::Dsm2Fast);
    assert_eq!((transmitter.failsafe, transmitter.others), (None, None));
}

#[test]
fn what_is_wrong_with_a_transmitter_is_shown_where_it_stands() {
    for (part, replacement, pieces) in [
        (
            "order = \"TAER\"",
            "order = \"TAEE\"",
            ["every stick once", "AETR"],
        ),
        (
            "arming_channel = 5",
            "arming_channel = 6",
            ["already in use", "a separate channel"],
        ),
        (
            "dsm = \"dsm2_fast\"",
            "dms = \"dsm2_fast\"",
            ["is unknown", "did you mean `dsm`?"],
        ),
        (
            "link = \"multi\"",
            "link = \"mutli\"",
            ["`mutli` is not known here", "did you mean `multi`?"],
        ),
    ] {
        let text = with(&plugged_in(), part, replacement);
        let shown = refusal(&text, &[]);
        for piece in pieces {
            assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
        }
    }
}
