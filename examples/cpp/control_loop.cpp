// Opens and closes a hand with a few numbers, 100 times a second.
//
//     control_loop SYNERGY OBJECT
//
// SYNERGY is a directory with `synergy.toml`, such as `synergies/shadow`. The numbers move from the open hand to the mean
// grasp of the object. Replace `send` with what commands your motors. At the end, the numbers of a measured posture are
// computed. The readers are toml++ (synergy.toml) and Eigen (matrices).

#include <toml++/toml.h>

#include <Eigen/Dense>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr auto kPeriod = std::chrono::milliseconds(10);
// Ticks of each part of the motion: a second to close, half a second to squeeze.
constexpr int kClose = 100, kSqueeze = 50;

[[noreturn]] void fail(const std::string& key) { throw std::runtime_error("synergy.toml has no usable entry " + key); }

const toml::array& array(const toml::table& table, const char* key) {
  const toml::array* found = table[key].as_array();
  return found ? *found : (fail(key), *found);
}

const toml::table& table(const toml::node* node, const char* key) {
  const toml::table* found = node ? node->as_table() : nullptr;
  return found ? *found : (fail(key), *found);
}

VectorXd vector(const toml::array& numbers) {
  VectorXd values(numbers.size());
  for (size_t i = 0; i < numbers.size(); ++i) values[i] = numbers[i].value<double>().value();
  return values;
}

MatrixXd matrix(const toml::array& rows) {
  MatrixXd values(rows.size(), rows.at(0).as_array()->size());
  for (size_t i = 0; i < rows.size(); ++i) values.row(i) = vector(*rows[i].as_array());
  return values;
}

// Names and limits of actuators or joints, in rad or m.
struct Axes {
  std::vector<std::string> names;
  VectorXd lower, upper;

  explicit Axes(const toml::array& entries) : lower(entries.size()), upper(entries.size()) {
    for (size_t i = 0; i < entries.size(); ++i) {
      const toml::table& entry = table(&entries[i], "name");
      names.push_back(entry["name"].value<std::string>().value());
      lower[i] = entry["lower"].value<double>().value();
      upper[i] = entry["upper"].value<double>().value();
    }
  }

  VectorXd clamp(const VectorXd& values) const { return values.cwiseMax(lower).cwiseMin(upper); }
};

// Commands the hand: each number is a joint position in rad or m, for the actuator of that name.
void send(const std::vector<std::string>& names, const VectorXd& command) {
  (void)names;
  (void)command;
}

void report(const char* moment, const char* kind, const Axes& axes, const VectorXd& values) {
  for (size_t i = 0; i < axes.names.size(); ++i)
    std::printf("%s %s %s %.17g\n", moment, kind, axes.names[i].c_str(), values[i]);
}

int run(const std::string& directory, const std::string& object) {
  const toml::table synergy = toml::parse_file(directory + "/synergy.toml");
  const toml::table& joint_map = table(synergy.get("joint_map"), "joint_map");
  const Axes actuators(array(synergy, "actuators")), joints(array(joint_map, "joints"));
  const VectorXd mean = vector(array(synergy, "mean")), joint_mean = vector(array(joint_map, "mean"));
  const MatrixXd components = matrix(array(synergy, "components")), joint_matrix = matrix(array(joint_map, "matrix"));

  const toml::table* grasp = nullptr;
  for (const toml::node& node : array(synergy, "grasps")) {
    const toml::table& candidate = table(&node, "grasps");
    if (candidate["object"].value<std::string>() == object && candidate["numbers"].value<int64_t>() == components.rows())
      grasp = &candidate;
  }
  if (!grasp) throw std::runtime_error("there is no grasp of " + object);
  const auto moment = [&](const char* name, const char* key) { return vector(array(table(grasp->get(name), name), key)); };

  struct Part {
    int ticks;
    const char *start, *end;
  };
  auto next_tick = std::chrono::steady_clock::now();
  for (const Part& part : {Part{kClose, "open", "closed"}, Part{kSqueeze, "closed", "held"}}) {
    const VectorXd start = moment(part.start, "z"), end = moment(part.end, "z");
    for (int tick = 0; tick <= part.ticks; ++tick) {
      const VectorXd z = start + double(tick) / part.ticks * (end - start);
      const VectorXd command = actuators.clamp(mean + components.transpose() * z);
      const VectorXd posture = joints.clamp(joint_mean + joint_matrix.transpose() * z);
      send(actuators.names, command);
      if (tick == 0 || tick == part.ticks) {
        report(tick == 0 ? part.start : part.end, "command", actuators, command);
        report(tick == 0 ? part.start : part.end, "joint", joints, posture);
      }
      next_tick += kPeriod;
      std::this_thread::sleep_until(next_tick);
    }
  }

  // The way back: the numbers whose joint positions are nearest to a measured posture. The arm's joints do not count.
  const VectorXd measured = moment("held", "q");
  MatrixXd slopes = joint_matrix.transpose();
  VectorXd moved = measured - joint_mean;
  if (const toml::array* free = joint_map["free"].as_array())
    for (const toml::node& name : *free)
      for (size_t i = 0; i < joints.names.size(); ++i)
        if (name.value<std::string>() == joints.names[i]) {
          slopes.row(i).setZero();
          moved[i] = 0;
        }
  const VectorXd numbers = slopes.colPivHouseholderQr().solve(moved);
  for (int i = 0; i < numbers.size(); ++i) std::printf("measured number %d %.17g\n", i + 1, numbers[i]);
  return 0;
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 3) {
    std::fprintf(stderr, "usage: control_loop SYNERGY OBJECT\n");
    return 2;
  }
  try {
    return run(arguments[1], arguments[2]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "control_loop: %s\n", error.what());
    return 1;
  }
}
