//! A browser without a screen, driven as people drive one: through its WebDriver (<https://www.w3.org/TR/webdriver2/>).

use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::process::{ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::Background;
use crate::http::ask;

/// The key that goes on to the next control.
pub const TAB: &str = "\u{E004}";
/// The key that presses it.
pub const ENTER: &str = "\u{E007}";

/// A window of a browser, closed when it is dropped.
#[derive(Debug)]
pub struct Browser {
    driver: SocketAddr,
    session: String,
    _process: Background,
    /// Open for as long as it may write there.
    _said: BufReader<ChildStdout>,
}

impl Browser {
    /// A window of `width` by `height` pixels, with dark colours where `dark`; `None`, with a printed line, where no ChromeDriver is
    /// installed and `RIG_BROWSER` does not say that one must be.
    pub fn open([width, height]: [u32; 2], dark: bool) -> Option<Self> {
        let mut command = Command::new("chromedriver");
        command.args(["--port=0"]).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = match command.spawn() {
            Ok(child) => child,
            Err(error) => {
                assert!(std::env::var_os("RIG_BROWSER").is_none(), "chromedriver: {error}");
                eprintln!("skipped: no chromedriver ({error})");
                return None;
            }
        };
        let mut said = BufReader::new(child.stdout.take().expect("its output"));
        let mut port = None;
        while port.is_none() {
            let mut line = String::new();
            assert!(said.read_line(&mut line).expect("its output") > 0, "chromedriver ended");
            let number = line.rsplit_once("on port ").map(|(_, number)| number.trim_end_matches(['.', '\n']));
            // first it says that any port will do
            port = number.and_then(|number| number.parse().ok()).filter(|&port: &u16| port != 0);
        }
        let process = Background::of(child);
        let driver = SocketAddr::from(([127, 0, 0, 1], port.expect("chromedriver says its port")));
        let mut arguments = vec![
            "--headless=new".to_owned(),
            "--no-sandbox".into(),
            "--disable-gpu".into(),
            "--disable-quic".into(),
            "--no-first-run".into(),
            "--disable-background-networking".into(),
            "--disable-component-update".into(),
            "--disable-sync".into(),
        ];
        if dark {
            arguments.push("--blink-settings=preferredColorScheme=0".into());
        }
        let capabilities = json!({ "capabilities": { "alwaysMatch": {
            "browserName": "chrome",
            "goog:loggingPrefs": { "browser": "ALL" },
            "goog:chromeOptions": {
                "args": arguments,
                "mobileEmulation": { "deviceMetrics": { "width": width, "height": height, "pixelRatio": 1.0, "touch": false } },
            },
        } } });
        let mut browser = Self { driver, session: String::new(), _process: process, _said: said };
        let session = browser.tell("POST", "", Some(capabilities));
        browser.session = format!("/{}", session["sessionId"].as_str().expect("a session"));
        Some(browser)
    }

    fn tell(&self, method: &str, path: &str, body: Option<Value>) -> Value {
        let head = "Host: localhost\r\nContent-Type: application/json\r\n";
        let body = body.map_or(String::new(), |body| body.to_string());
        let answer = ask(self.driver, method, &format!("/session{}{path}", self.session), head, &body);
        let value = answer.json()["value"].clone();
        assert_eq!(answer.status, 200, "{method} {path}: {value}");
        value
    }

    /// Goes to `address`.
    pub fn go(&self, address: &str) {
        self.tell("POST", "/url", Some(json!({ "url": address })));
    }

    /// What `script`, the body of a function, gives.
    pub fn run(&self, script: &str) -> Value {
        self.tell("POST", "/execute/sync", Some(json!({ "script": script, "args": [] })))
    }

    /// The text of what `selector` finds first.
    pub fn text(&self, selector: &str) -> String {
        let script = format!("return document.querySelector({})?.textContent ?? ''", json!(selector));
        self.run(&script).as_str().unwrap_or_default().to_owned()
    }

    /// Waits until the text of what `selector` finds first holds `text`.
    pub fn wait_for(&self, selector: &str, text: &str, seconds: f64) {
        self.wait_until(&format!("`{text}` in {selector}"), seconds, || self.text(selector).contains(text));
    }

    /// Waits until `condition` holds; fails with `what` and all that the page says after `seconds`.
    pub fn wait_until(&self, what: &str, seconds: f64, mut condition: impl FnMut() -> bool) {
        let deadline = Instant::now() + ground::strict::duration(seconds);
        while !condition() {
            let said = || self.run("return document.body.innerText");
            assert!(
                Instant::now() < deadline,
                "{what} did not happen within {seconds} s on a page that says {}",
                said()
            );
            // a look costs the browser something, and what it looks at
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn element(&self, selector: &str) -> String {
        let found =
            self.tell("POST", "/element", Some(json!({ "using": "css selector", "value": selector })));
        let id = found.as_object().and_then(|found| found.values().next()?.as_str().map(str::to_owned));
        format!("/element/{}", id.expect("an element"))
    }

    /// Clicks on what `selector` finds first, where it can be seen.
    pub fn click(&self, selector: &str) {
        self.tell("POST", &format!("{}/click", self.element(selector)), Some(json!({})));
    }

    /// Types `keys` where the focus is.
    pub fn keys(&self, keys: &str) {
        let press = |key: char| {
            [json!({ "type": "keyDown", "value": key }), json!({ "type": "keyUp", "value": key })]
        };
        let actions: Vec<Value> = keys.chars().flat_map(press).collect();
        let keyboard = json!({ "type": "key", "id": "keyboard", "actions": actions });
        self.tell("POST", "/actions", Some(json!({ "actions": [keyboard] })));
    }

    /// Turns to the newest window.
    pub fn newest_window(&self) {
        let windows = self.tell("GET", "/window/handles", None);
        let newest = windows.as_array().and_then(|windows| windows.last()).cloned();
        self.tell("POST", "/window", Some(json!({ "handle": newest })));
    }

    /// What its console was told of errors.
    pub fn errors(&self) -> Vec<String> {
        let log = self.tell("POST", "/se/log", Some(json!({ "type": "browser" })));
        let messages = log.as_array().into_iter().flatten().filter(|entry| entry["level"] == "SEVERE");
        messages.filter_map(|entry| entry["message"].as_str().map(str::to_owned)).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let head = "Host: localhost\r\n";
        if std::net::TcpStream::connect(self.driver).is_err() {
            return;
        }
        let _ = ask(self.driver, "DELETE", &format!("/session{}", self.session), head, "");
    }
}
