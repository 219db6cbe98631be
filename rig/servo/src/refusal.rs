//! A board's refusal in words: what, on which channel, the limit, and what to do.

use firmware_protocol::event::{Ack, Fault, Refusal, State};

/// Why the board refused.
pub(super) fn explain(ack: &Ack) -> String {
    let (limit, got) = (ack.limit, ack.got);
    let code = |number: u32| u8::try_from(number).unwrap_or(u8::MAX);
    let fault = |number| Fault::from_code(code(number)).map_or("an unknown fault", Fault::text);
    let details = match ack.refusal {
        Refusal::PulseTooShort => {
            format!(": {got} µs, limit {limit} µs; ask for more or change the channel's limits")
        }
        Refusal::PulseTooLong => {
            format!(": {got} µs, limit {limit} µs; ask for less or change the channel's limits")
        }
        Refusal::RateTooHigh => {
            format!(": {got} µs/s, limit {limit} µs/s; take longer or raise max_rate_us_per_s")
        }
        Refusal::Busy => {
            let state = State::from_code(code(got)).map_or("in an unknown state", State::text);
            format!(": it is {state}; wait for its end or stop it")
        }
        Refusal::Latched => format!(": {}", fault(got)),
        Refusal::OtherFault => format!(": {}", fault(limit)),
        Refusal::Underflow => format!(": {got} µs ahead, at least {limit} µs wanted; start later"),
        Refusal::TooFar => format!(": {got} µs ahead, limit {limit} µs; start sooner"),
        Refusal::NotAtStart if limit == 0 => format!(": it is detached, wanted {got} µs"),
        Refusal::NotAtStart => format!(": it is at {limit} µs, wanted {got} µs"),
        Refusal::Version => format!(": its {limit}, ours {got}; flash firmware of version {got}"),
        Refusal::NoSuchChannel => format!(": it has {limit}, numbered from 0; correct id"),
        Refusal::NoRoom => format!(": {got}, and it holds {limit}; reduce cycles"),
        Refusal::TooLong => format!(": {got} µs, limit {limit} µs; reduce cycles or durations"),
        Refusal::BadTiming => format!(": {got} ms, the nearest allowed is {limit} ms"),
        Refusal::None
        | Refusal::Malformed
        | Refusal::NotConfigured
        | Refusal::OutOfOrder
        | Refusal::Incomplete
        | Refusal::BadLimits
        | Refusal::NoSession => String::new(),
    };
    let on = ack.channel.map_or(String::new(), |channel| format!("channel {channel}: "));
    format!("{on}{}{details}", ack.refusal)
}

#[cfg(test)]
mod tests {
    use firmware_protocol::units::Channel;

    use super::*;

    #[test]
    fn every_refusal_reads_as_a_sentence() {
        let all: Vec<String> = Refusal::ALL
            .iter()
            .map(|&refusal| {
                explain(&Ack { command: 0x16, refusal, channel: Some(Channel(2)), limit: 1, got: 3 })
            })
            .collect();
        insta::assert_snapshot!(all.join("\n"), @r"
        channel 2: done
        channel 2: not a command of this protocol version
        channel 2: protocol versions differ: its 1, ours 3; flash firmware of version 3
        channel 2: no such channel: it has 1, numbered from 0; correct id
        channel 2: channel is not configured
        channel 2: pulse is shorter than the channel's limit: 3 µs, limit 1 µs; ask for more or change the channel's limits
        channel 2: pulse is longer than the channel's limit: 3 µs, limit 1 µs; ask for less or change the channel's limits
        channel 2: pulse changes faster than the channel's limit: 3 µs/s, limit 1 µs/s; take longer or raise max_rate_us_per_s
        channel 2: not possible in the board's present state: it is jogging; wait for its end or stop it
        channel 2: a fault is latched and must be acknowledged first: another host session began while a profile was armed or running
        channel 2: start tick is in the past or too near: 3 µs ahead, at least 1 µs wanted; start later
        channel 2: start tick is too far ahead: 3 µs ahead, limit 1 µs; start sooner
        channel 2: channel is not at the profile's start pulse; jog it there first: it is at 1 µs, wanted 3 µs
        channel 2: profile segments are out of order
        channel 2: profile has more segments than the board holds: 3, and it holds 1; reduce cycles
        channel 2: profile is incomplete
        channel 2: profile is too long: 3 µs, limit 1 µs; reduce cycles or durations
        channel 2: another fault is latched: dead-man: the host was silent for too long; check the cable and the host's load
        channel 2: channel limits contradict each other
        channel 2: dead-man time is out of range: 3 ms, the nearest allowed is 1 ms
        channel 2: no session; say hello first
        ");
    }
}
