#pragma once

#include "core/model/model.h"
#include "server/wire/json_fields.h"

namespace valvetriage {

/// Most roots, and most knots of a map, that a model from outside may have; the product's own models stay far below.
inline constexpr std::size_t kMaxModelRoots = 64;
inline constexpr std::size_t kMaxMapKnots = 10000;
/// Most physical causes in one model; an analysis finds at most three.
inline constexpr std::size_t kMaxModelMechanisms = 32;

/// {"domain","sample_time_s","zeros":[[re,im]],"poles":[[re,im]],"gain","delay_s"} (schemas/model.schema.json).
Json to_json(const TransferFunction& g);

/// Errors  of JsonFields; roots without their conjugate, more zeros than poles, a negative delay or one that is no
/// whole
///         number of samples (z), a sample time that does not fit the domain
TransferFunction transfer_function_from_json(JsonFields fields);

/// The model document: schemas/model.schema.json, self-contained, what `simulate --model` takes.
Json to_json(const Model& model);

/// A model document, or a whole `identify` result (its transfer function and offsets).
///
/// Errors  of the fields, each with its JSON pointer; `not_a_model` for another kind of document, with a hint
Result<Model> model_from_json(const Json& document);

/// The same as part of a larger document.
Model model_from_json(JsonFields fields);

}  // namespace valvetriage
