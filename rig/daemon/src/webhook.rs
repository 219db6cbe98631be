//! An alert that is posted to an address.

use std::sync::Arc;
use std::time::Duration;

use ureq::tls::{RootCerts, TlsConfig};
use ureq::{Agent, Timeout};

use config::Webhook;

/// Time for one delivery, from the name lookup to the end of the answer; after it, it is tried again later. Chosen.
const WEBHOOK_TIMEOUT: Duration = Duration::from_secs(25);

/// Posts `message`, JSON, to `hook`: by the machine's own certificates, through the proxy that the environment names. Only a status of
/// 200 to 299 says that it was taken; an address that sends elsewhere is not followed, for nobody has named the other one.
///
/// # Errors
/// What went wrong, with the host and no more of the address: what follows may be a secret.
pub(super) fn post(hook: &Webhook, message: &str) -> Result<(), String> {
    let host = hook.host().unwrap_or("an address without a host");
    let failed = |why: &dyn std::fmt::Display| format!("posting it to {host}: {why}");
    let cryptography = Arc::new(rustls::crypto::ring::default_provider());
    let tls = TlsConfig::builder()
        .root_certs(RootCerts::PlatformVerifier)
        .unversioned_rustls_crypto_provider(cryptography)
        .build();
    let agent = Agent::config_builder()
        .tls_config(tls)
        .timeout_global(Some(WEBHOOK_TIMEOUT))
        .max_redirects(0)
        .http_status_as_error(false)
        .user_agent(concat!("rig/", env!("CARGO_PKG_VERSION")))
        .build();
    let posted = Agent::from(agent).post(hook.url()).content_type("application/json").send(message);
    match posted {
        Ok(answer) if answer.status().is_success() => Ok(()),
        Ok(answer) if answer.status().is_redirection() => Err(failed(&format!(
            "{} sends elsewhere, which is not followed; name that address",
            answer.status()
        ))),
        Ok(answer) => Err(failed(&format!("it answers {}", answer.status()))),
        Err(ureq::Error::Timeout(Timeout::Global | Timeout::PerCall)) => {
            Err(failed(&format!("not done within {} s", WEBHOOK_TIMEOUT.as_secs())))
        }
        // it says the whole of it
        Err(ureq::Error::BadUri(_)) => Err(failed(&"it cannot be asked")),
        Err(error) => Err(failed(&error)),
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead as _, BufReader, Read as _, Write as _};
    use std::net::TcpListener;

    use super::*;

    /// What is said of an address that answers so, and what it was sent.
    fn posted(answer: &'static str) -> (Result<(), String>, String) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let hook: Webhook =
            format!("http://{}/services/SECRET?key=SECRET", listener.local_addr().unwrap()).into();
        let asked = std::thread::spawn(move || {
            let mut stream = BufReader::new(listener.accept().unwrap().0);
            let (mut length, mut head) = (0, String::new());
            while !head.ends_with("\r\n\r\n") {
                let begun = head.len();
                stream.read_line(&mut head).unwrap();
                if let Some(value) = head[begun..].to_lowercase().strip_prefix("content-length:") {
                    length = value.trim().parse().unwrap();
                }
            }
            let mut body = vec![0; length];
            stream.read_exact(&mut body).unwrap();
            write!(stream.get_mut(), "HTTP/1.1 {answer}\r\nConnection: close\r\n\r\n").unwrap();
            head + &String::from_utf8(body).unwrap()
        });
        let said = post(&hook, r#"{"kind":"drift"}"#);
        (said, asked.join().unwrap())
    }

    #[test]
    fn webhook_is_taken_by_a_success_alone_and_its_address_stays_secret() {
        let (said, asked) = posted("204 No Content");
        assert_eq!(said, Ok(()));
        assert!(asked.starts_with("POST /services/SECRET?key=SECRET HTTP/1.1\r\n"), "{asked}");
        assert!(asked.to_lowercase().contains("content-type: application/json\r\n"), "{asked}");
        assert!(asked.ends_with(r#"{"kind":"drift"}"#), "{asked}");
        for (answer, says) in [
            ("302 Found\r\nLocation: http://127.0.0.1:1/", "302 Found sends elsewhere"),
            ("307 Temporary Redirect\r\nLocation: http://127.0.0.1:1/", "sends elsewhere"),
            ("404 Not Found", "it answers 404 Not Found"),
            ("503 Service Unavailable\r\nContent-Length: 1000000", "it answers 503"),
        ] {
            let (said, _) = posted(answer);
            let said = said.unwrap_err();
            assert!(said.contains("127.0.0.1") && said.contains(says) && !said.contains("SECRET"), "{said}");
        }
    }

    #[test]
    fn webhook_that_cannot_be_reached_is_told_by_its_host_alone() {
        let closed = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let unanswered = [format!("http://{closed}/SECRET"), format!("https://user:SECRET@{closed}/SECRET")];
        for url in unanswered.into_iter().chain(["http:///SECRET".into(), "SECRET \u{7f}".into()]) {
            let said = post(&url.clone().into(), "{}").unwrap_err();
            assert!(!said.contains("SECRET"), "{url}: {said}");
        }
    }
}
