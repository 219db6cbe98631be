//! The document of the API is what other people's code takes it for, and the daemon does what it says.

use std::process::Command;

use system_tests::daemon::Served;
use system_tests::python::python;
use system_tests::{in_real_time, printed};

#[test]
fn a_validator_that_is_not_ours_finds_nothing_wrong_with_the_document() {
    let Some(python) = python("the API's document", &["openapi_spec_validator"]) else { return };
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    let document = served.get("/api/v1/openapi.json");
    let file = served.bench.runs.with_file_name("openapi.json");
    std::fs::write(&file, &document.body).expect("a file");
    let output = Command::new(python).args(["-m", "openapi_spec_validator"]).arg(&file).output();
    let output = output.expect("Python starts");
    assert!(output.status.success(), "{}", printed(&output));

    let document = document.json();
    assert_eq!(document["openapi"], "3.1.0");
    let problem = &document["components"]["responses"]["Problem"]["content"]["application/json"]["schema"];
    assert_eq!(problem["$ref"], "#/components/schemas/Problem");
    for (path, item) in document["paths"].as_object().expect("paths") {
        for (method, operation) in item.as_object().expect("operations") {
            let responses = operation["responses"].as_object().expect("responses");
            for (status, response) in responses.iter().filter(|(status, _)| status.as_str() >= "400") {
                assert_eq!(response["$ref"], "#/components/responses/Problem", "{method} {path} {status}");
            }
            let security = operation["security"].as_array().expect("security");
            assert_eq!(
                security.contains(&serde_json::json!({})),
                method == "get",
                "{method} {path}: {security:?}"
            );
        }
    }
}

#[test]
fn clients_made_from_the_document_are_answered_as_it_says() {
    let Some(python) = python("clients made from the API's document", &["schemathesis"]) else { return };
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    let url = format!("http://{}", served.address);
    let output = Command::new(python)
        .args(["-c", "from schemathesis.cli import schemathesis; schemathesis()", "run"])
        .arg(format!("{url}/api/v1/openapi.json"))
        .args(["--header", &format!("Authorization: Bearer {}", served.token)])
        // they have no end to wait for
        .args(["--exclude-path-regex", "/(events|live)$"])
        .args([
            "--checks",
            "not_a_server_error,status_code_conformance,content_type_conformance,response_schema_conformance",
        ])
        .args(["--phases", "examples,coverage,fuzzing", "--max-examples", "10", "--seed", "1", "--no-color"])
        .args(["--generation-database", "none", "--warnings", "off"])
        .current_dir(served.bench.runs.parent().expect("a folder"))
        .output()
        .expect("Python starts");
    assert!(output.status.success(), "{}", printed(&output));
    assert!(printed(&output).contains("Test cases:"), "{}", printed(&output));
}
