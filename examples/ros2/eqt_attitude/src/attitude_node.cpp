// Calls an exported law at its period: attitude and setpoint in, torque out.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>

#include "geometry_msgs/msg/wrench_stamped.hpp"
#include "nav_msgs/msg/odometry.hpp"
#include "rclcpp/rclcpp.hpp"
#include "trajectory_msgs/msg/multi_dof_joint_trajectory_point.hpp"

#include "law.h"

using geometry_msgs::msg::WrenchStamped;
using nav_msgs::msg::Odometry;
using Setpoint = trajectory_msgs::msg::MultiDOFJointTrajectoryPoint;

// The rotation matrix of a quaternion from body to space, row by row; false if it has no length.
template <class Quaternion>
bool matrix(const Quaternion &q, double R[9]) {
  const double norm = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  if (!(norm > 1e-6)) return false;  // NaN, too
  const double w = q.w / norm, x = q.x / norm, y = q.y / norm, z = q.z / norm;
  const double rows[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                          2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                          2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)};
  std::copy(rows, rows + 9, R);
  return true;
}

template <class Vector>
void numbers_of(const Vector &v, double out[3]) {
  out[0] = v.x, out[1] = v.y, out[2] = v.z;
}

class AttitudeNode : public rclcpp::Node {
 public:
  AttitudeNode() : Node("attitude_node") {
    // The numbers of the experiment, unless parameters change them.
    numbers_ = law_defaults;
    timeout_ = declare_parameter<double>("timeout", 0.1);  // s
    torque_ = create_publisher<WrenchStamped>("torque", 1);
    odometry_ = create_subscription<Odometry>("odom", 1, [this](Odometry::ConstSharedPtr m) {
      // Twist of Odometry is in the child frame, which is the body.
      measured_ = matrix(m->pose.pose.orientation, input_.pose);
      numbers_of(m->twist.twist.angular, input_.velocity);
      last_ = now();
    });
    setpoint_ = create_subscription<Setpoint>("setpoint", 1, [this](Setpoint::ConstSharedPtr m) {
      // Velocity and acceleration in the frame of the desired body; 0 if they are left out.
      if (m->transforms.empty()) return;
      desired_ = matrix(m->transforms[0].rotation, input_.desired_pose);
      const geometry_msgs::msg::Vector3 none;
      numbers_of(m->velocities.empty() ? none : m->velocities[0].angular, input_.desired_velocity);
      numbers_of(m->accelerations.empty() ? none : m->accelerations[0].angular,
           input_.desired_acceleration);
    });
    const std::chrono::duration<double> period(numbers_.period);
    timer_ = create_wall_timer(period, [this] { step(); });
  }

 private:
  void step() {
    WrenchStamped out;
    out.header.stamp = now();
    out.header.frame_id = "base_link";
    if (measured_ && desired_ && (now() - last_).seconds() <= timeout_) {
      if (!started_) {
        first_ = now();
        law_start(&numbers_, &memory_, &input_);
        started_ = true;
      }
      input_.t = (now() - first_).seconds();
      double torque[3];
      law_torque(&numbers_, &memory_, &input_, torque);  // N m, body frame
      out.wrench.torque.x = torque[0], out.wrench.torque.y = torque[1];
      out.wrench.torque.z = torque[2];
    } else {
      started_ = false;  // no torque without a fresh attitude; a law with memory starts anew
    }
    torque_->publish(out);
  }

  law_numbers numbers_{};
  law_memory memory_{};
  law_input input_{};
  bool measured_ = false, desired_ = false, started_ = false;
  double timeout_;
  rclcpp::Time last_, first_;
  rclcpp::Publisher<WrenchStamped>::SharedPtr torque_;
  rclcpp::Subscription<Odometry>::SharedPtr odometry_;
  rclcpp::Subscription<Setpoint>::SharedPtr setpoint_;
  rclcpp::TimerBase::SharedPtr timer_;
};

int main(int argc, char **argv) {
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<AttitudeNode>());
  rclcpp::shutdown();
}
