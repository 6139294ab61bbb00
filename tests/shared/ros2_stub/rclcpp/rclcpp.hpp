// As much of rclcpp and of the messages as the example node uses, so that it runs without ROS.
//
// `spin` plays the lines of the standard input: a time in s, and `m` with a measured or `s` with a
// desired quaternion wxyz, angular velocity and angular acceleration, or `t` for the timer. What is
// published is printed. As in ROS, times of different clocks may not be subtracted.
#pragma once
#include <chrono>
#include <cstdio>
#include <functional>
#include <iostream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace rclcpp {
struct Duration {
  double value;
  double seconds() const { return value; }
};
struct Time {
  double value = 0;
  bool of_node = false;
  Duration operator-(const Time &other) const {
    if (of_node != other.of_node) throw std::runtime_error("times of different clocks");
    return {value - other.value};
  }
};
}  // namespace rclcpp

namespace geometry_msgs::msg {
struct Vector3 {
  double x = 0, y = 0, z = 0;
};
struct Quaternion {
  double x = 0, y = 0, z = 0, w = 1;
};
struct Transform {
  Quaternion rotation;
};
struct Twist {
  Vector3 linear, angular;
};
struct WrenchStamped {
  struct {
    rclcpp::Time stamp;
    std::string frame_id;
  } header;
  struct {
    Vector3 force, torque;
  } wrench;
};
}  // namespace geometry_msgs::msg

namespace nav_msgs::msg {
struct Odometry {
  using ConstSharedPtr = std::shared_ptr<const Odometry>;
  struct {
    struct {
      geometry_msgs::msg::Quaternion orientation;
    } pose;
  } pose;
  struct {
    geometry_msgs::msg::Twist twist;
  } twist;
};
}  // namespace nav_msgs::msg

namespace trajectory_msgs::msg {
struct MultiDOFJointTrajectoryPoint {
  using ConstSharedPtr = std::shared_ptr<const MultiDOFJointTrajectoryPoint>;
  std::vector<geometry_msgs::msg::Transform> transforms;
  std::vector<geometry_msgs::msg::Twist> velocities, accelerations;
};
}  // namespace trajectory_msgs::msg

namespace rclcpp {
inline Time present{0, true};
inline std::function<void()> on_timer;
template <class T>
inline std::function<void(std::shared_ptr<const T>)> on_message;

struct TimerBase {
  using SharedPtr = std::shared_ptr<TimerBase>;
};
template <class T>
struct Subscription {
  using SharedPtr = std::shared_ptr<Subscription>;
};
template <class T>
struct Publisher {
  using SharedPtr = std::shared_ptr<Publisher>;
  void publish(const T &m) {
    const auto &torque = m.wrench.torque;
    std::printf("%.17g %.17g %.17g\n", torque.x, torque.y, torque.z);
  }
};
class Node {
 public:
  explicit Node(const std::string &) {}
  Time now() const { return present; }
  template <class T>
  T declare_parameter(const std::string &, const T &value) {
    return value;
  }
  template <class T>
  std::shared_ptr<Publisher<T>> create_publisher(const std::string &, int) {
    return std::make_shared<Publisher<T>>();
  }
  template <class T, class F>
  std::shared_ptr<Subscription<T>> create_subscription(const std::string &, int, F f) {
    on_message<T> = f;
    return std::make_shared<Subscription<T>>();
  }
  template <class R, class P, class F>
  TimerBase::SharedPtr create_wall_timer(std::chrono::duration<R, P> period, F f) {
    std::printf("%g\n", std::chrono::duration<double>(period).count());
    on_timer = f;
    return std::make_shared<TimerBase>();
  }
};

inline void init(int, char **) {}
inline void shutdown() {}
template <class N>
void spin(std::shared_ptr<N>) {
  using nav_msgs::msg::Odometry;
  using Setpoint = trajectory_msgs::msg::MultiDOFJointTrajectoryPoint;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream in(line);
    char kind;
    geometry_msgs::msg::Quaternion q;
    geometry_msgs::msg::Twist w, a;
    in >> present.value >> kind >> q.w >> q.x >> q.y >> q.z;
    in >> w.angular.x >> w.angular.y >> w.angular.z;
    in >> a.angular.x >> a.angular.y >> a.angular.z;
    if (kind == 't') {
      on_timer();
    } else if (kind == 'm') {
      Odometry m;
      m.pose.pose.orientation = q;
      m.twist.twist = w;
      on_message<Odometry>(std::make_shared<Odometry>(m));
    } else {
      on_message<Setpoint>(std::make_shared<Setpoint>(Setpoint{{{q}}, {w}, {a}}));
    }
  }
}
}  // namespace rclcpp
