//! The document that describes the API (<https://spec.openapis.org/oas/v3.1.1.html>): written by the handlers' own attributes, and
//! here what all of them have in common, so that none can forget it.

use axum::Json;
use utoipa::openapi::path::Operation;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Content, OpenApi, Ref, RefOr, Response, ResponseBuilder, Schema};
use utoipa::{Modify, OpenApi as _};

use super::Document;

/// The response of every refusal.
const REFUSAL: &str = "Problem";
/// Schemas that stand in others beside their `kind`: as wholes of their own they would forbid it.
const JOINED: [&str; 2] = ["Chosen", "WantedRuns"];
/// How whoever asks says the token.
const TOKEN: &str = "token";

/// Adds to the API's document what all operations have in common: errors, authorisation, limits.
pub(super) struct InCommon;

impl Modify for InCommon {
    fn modify(&self, document: &mut OpenApi) {
        let components = document.components.get_or_insert_default();
        components.responses.insert(REFUSAL.into(), refusal().into());
        let token = HttpBuilder::new().scheme(HttpAuthScheme::Bearer);
        let token = token.description(Some("What stands in `.token` in the runs folder."));
        components.add_security_scheme(TOKEN, SecurityScheme::Http(token.build()));
        for name in JOINED {
            if let Some(RefOr::T(Schema::Object(part))) = components.schemas.get_mut(name) {
                part.additional_properties = None;
            }
        }
        for (path, item) in &mut document.paths.paths {
            let is_looked_up = path.contains('{');
            let operations = [(&mut item.get, true), (&mut item.post, false)];
            for (operation, reads) in
                operations.into_iter().filter_map(|(each, reads)| Some((each.as_mut()?, reads)))
            {
                put_into(operation, is_looked_up, reads);
            }
        }
    }
}

/// How it is refused, and with what it is asked for.
fn put_into(operation: &mut Operation, is_looked_up: bool, reads: bool) {
    let always = ["401", "403", "408", "500"];
    let looked_up = ["400", "404"].iter().filter(|_| is_looked_up);
    let changes = ["409", "413", "422", "429"].iter().filter(|_| !reads);
    for status in always.iter().chain(looked_up).chain(changes) {
        let refusal = || Ref::from_response_name(REFUSAL).into();
        operation.responses.responses.entry((*status).to_owned()).or_insert_with(refusal);
    }
    let with_token = SecurityRequirement::new(TOKEN, [] as [&str; 0]);
    // on the loopback reading is free
    let free = reads.then(SecurityRequirement::default);
    operation.security = Some(free.into_iter().chain([with_token]).collect());
}

fn refusal() -> Response {
    let content = Content::new(Some(Ref::from_schema_name("Problem")));
    let words = "Refused: what is wrong, and what to do.";
    ResponseBuilder::new().description(words).content("application/json", content).build()
}

/// This document.
#[utoipa::path(get, path = "/api/v1/openapi.json", responses((status = 200, description = "An OpenAPI document.", body = Object)))]
pub(super) async fn document() -> Json<OpenApi> {
    Json(Document::openapi())
}
