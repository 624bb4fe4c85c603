#pragma once

#include <functional>
#include <string_view>

#include "core/mechanisms/mechanism.h"
#include "core/model/model.h"

namespace valvetriage {

/// Free run of a model with its physical causes: `simulate`, and the laws of `model.mechanisms` around its blocks in
/// their order (mechanism.h tells where each acts).
///
///   u → [kInput] → magnetic loop, delay, spool → [kPosition] → map → [kSteady] → volume → + output_offset → [kOutput]
///   → [kReading]
///
/// Equal to `simulate` to the last bit where there are no mechanisms. The output's range R and the input's are those of
/// the map; a linear model has none, so R is that of its own run without laws. `side_input` takes its channel by name
/// (MechanismUse::channel); `intermittent` acts in the recording that `channel` names, in every one where it is empty.
///
/// returns  one value per grid sample of the recording, unit of the output
/// Errors   as `simulate`; `unknown_cause`; `bad_parameter` for a wrong number of them or one that is not finite where
///          it must be; `needs_volume` for a flow law on a model without one; `missing_channel`; `no_static_gain` for a
///          law on the position of a linear model without one
/// Cost     that of `simulate` and one pass per law
Result<std::vector<double>> simulate_extended(const Model& model, const Recording& recording,
                                              const InitialState& initial, Horizon horizon = Horizon::kUnbounded);

/// The same on an input alone; there are no side channels then, and `intermittent` acts where its `channel` is empty.
Result<std::vector<double>> simulate_extended(const Model& model, const IntervalSignal& input, double sample_period_s,
                                              std::span<const double> measured, const InitialState& initial,
                                              Horizon horizon = Horizon::kUnbounded);

/// The model whose blocks the laws inside the valve have changed (loop, delay, volume); its mechanisms stay listed.
/// Errors  as simulate_extended
Result<Model> with_reshaped_blocks(const Model& model);

/// The model on an input that comes without side channels, each of them staying at the value that `value_of` tells by
/// its name: a `side_input` is a constant offset of the reading then.
Model with_channels_at(const std::function<double(std::string_view)>& value_of, Model model);

/// A signal as kInput laws see it, the start and the end of each interval one after the other, and back.
std::vector<double> interleaved(const IntervalSignal& signal);
IntervalSignal intervals(std::span<const double> interleaved);

/// The driver of kInput laws: `loop_driver` on the same entries.
std::vector<double> interleaved_driver(const IntervalSignal& signal);

/// Stamps of `samples` samples from 0 on; those of kInput laws with two per sample.
std::vector<double> law_stamps(std::size_t samples, double sample_period_s);
std::vector<double> interleaved_stamps(std::size_t samples, double sample_period_s);

}  // namespace valvetriage
