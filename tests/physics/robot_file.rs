//! Mechanisms from robot files.

use iplw::task::joint::{Control, JointKind};
use iplw::task::scene::Inertia;
use iplw::task::{ImportedMechanism, mechanism_from_xml};
use iplw::world::mechanism::Tree;

const CART_POLE: &str = r#"<mujoco model="cart_pole">
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81" timestep="0.004"/>
  <default><joint damping="0.1"/><default class="thin"><geom type="capsule" size="0.05"/></default></default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="cart" pos="0 0 1">
      <joint name="slider" type="slide" axis="1 0 0" range="-1 1" damping="0"/>
      <geom type="box" size="0.2 0.1 0.05" mass="2"/>
      <body name="pole" pos="0 0 0.1" euler="0 3.141592653589793 0">
        <joint name="hinge" type="hinge" axis="0 1 0" frictionloss="0.02" armature="0.003" stiffness="0.5" springref="0.1"/>
        <geom class="thin" fromto="0 0 0 0 0 0.6"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="slider" gear="100" ctrlrange="-1 1"/></actuator>
  <equality><weld body1="cart" body2="pole"/></equality>
</mujoco>"#;

fn import(text: &str) -> ImportedMechanism {
    mechanism_from_xml(text).unwrap()
}

#[test]
fn mjcf_gives_joints_masses_and_motors() {
    let ImportedMechanism { scene, left_out } = import(CART_POLE);
    assert_eq!((scene.time_step, scene.gravity), (0.004, [0.0, -9.81]));
    let [slider, hinge] = &scene.joints[..] else { panic!("{:?}", scene.joints) };
    assert_eq!((slider.kind, hinge.kind), (JointKind::Prismatic, JointKind::Revolute));
    assert!(slider.effects.is_empty() && hinge.parent.as_deref() == Some("cart"));
    let value = |name: &str, parameter: &str| {
        hinge.effects.iter().find(|e| e.name == name).unwrap().parameters[parameter]
    };
    assert_eq!((value("viscous_friction", "b"), value("coulomb_friction", "torque")), (0.1, 0.02));
    assert_eq!(hinge.armature, 0.003);
    assert!(slider.limits.is_some() && hinge.limits.is_none());
    assert!((hinge.spring.unwrap().stiffness - 0.5).abs() < 1e-12);
    // The pole is turned by pi: it hangs from the joint at 1.1 m.
    let pole = scene.body("pole").unwrap();
    let [x, y] = pole.position.unwrap();
    assert!(x.abs() < 1e-9 && (y - 0.8).abs() < 1e-9, "{x} {y}");
    let (r, length, pi) = (0.05f64, 0.6, std::f64::consts::PI);
    let (tube, ball) = (1000.0 * pi * r * r * length, 1000.0 * 4.0 / 3.0 * pi * r.powi(3));
    assert!((pole.mass.unwrap() - tube - ball).abs() < 1e-9);
    let wanted = tube * (length * length / 12.0 + r * r / 4.0)
        + ball * (0.4 * r * r + 0.25 * length * length + 0.375 * length * r);
    assert!(matches!(pole.inertia, Some(Inertia::Value(found)) if (found - wanted).abs() < 1e-9));
    assert_eq!((scene.motors[0].control, scene.motors[0].max_torque), (Control::Torque, 100.0));
    for told in ["gear, 100", "<equality>", "Geoms of the world"] {
        assert!(left_out.iter().any(|line| line.contains(told)), "{told}: {left_out:?}");
    }
    Tree::of(&scene).unwrap();
}

/// The plane is that of the hinges: here x and y, seen from above.
#[test]
fn a_horizontal_arm_has_no_gravity() {
    let scene = import(
        r#"<mujoco><worldbody><body><joint name="a" axis="0 0 1"/><geom type="sphere" size="0.1" pos="1 0 0"/>
           <body pos="1 0 0"><joint name="b" axis="0 0 -1"/><geom type="sphere" size="0.1" pos="1 0 0"/></body></body></worldbody></mujoco>"#,
    );
    assert_eq!(scene.scene.gravity, [0.0, 0.0]);
    assert!(scene.left_out.iter().any(|line| line.contains("of b have the opposite sign")));
}

/// Two joints of one body become two links.
#[test]
fn joints_of_one_body_are_chained() {
    let found = import(
        r#"<mujoco><worldbody><body name="b"><joint name="x" type="slide" axis="1 0 0"/><joint name="turn" axis="0 1 0"/>
           <geom type="box" size="0.1 0.1 0.2" mass="1"/></body></worldbody></mujoco>"#,
    );
    assert_eq!(found.scene.bodies.len(), 2);
    assert_eq!(found.scene.joints[1].parent.as_deref(), Some("b_1"));
    assert!(found.scene.bodies[0].mass.unwrap() < 1e-5);
}

const URDF: &str = r#"<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.2"/><mass value="0.6"/><inertia ixx="0.01" iyy="0.008" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 -0.2"/><geometry><cylinder radius="0.02" length="0.4"/></geometry></visual></link>
  <link name="gripper"><inertial><mass value="0.2"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="3" velocity="5"/><dynamics damping="0.05" friction="0.01"/></joint>
  <joint name="wrist" type="fixed"><parent link="upper"/><child link="gripper"/><origin xyz="0 0 -0.4"/></joint>
</robot>"#;

#[test]
fn urdf_joins_what_is_fixed() {
    let ImportedMechanism { scene, left_out } = import(URDF);
    assert_eq!((scene.bodies.len(), scene.joints.len(), scene.motors.len()), (1, 1, 1));
    let upper = &scene.bodies[0];
    assert!((upper.mass.unwrap() - 0.8).abs() < 1e-12);
    let [x, y] = upper.position.unwrap();
    assert!(x.abs() < 1e-9 && (y - 0.75).abs() < 1e-9, "{x} {y}");
    let wanted = 0.008 + 0.001 + 0.6 * 0.05 * 0.05 + 0.2 * 0.15 * 0.15;
    assert!(matches!(upper.inertia, Some(Inertia::Value(found)) if (found - wanted).abs() < 1e-12));
    assert_eq!(scene.motors[0].max_torque, 3.0);
    let limits = scene.joints[0].limits.unwrap();
    assert_eq!((limits.low, limits.high), (-1.0, 1.0));
    assert!(!left_out.iter().any(|line| line.contains("limits")), "{left_out:?}");
}

#[test]
fn errors_name_the_part() {
    for (text, reason) in [
        (
            "<mujoco><worldbody><body><joint name='a' axis='0 0 1'/><geom size='0.1'/><body><joint name='b' axis='0 1 0'/><geom size='0.1'/></body></body></worldbody></mujoco>",
            "b leaves the plane",
        ),
        (
            "<mujoco><worldbody><body name='free'><freejoint/><geom size='0.1'/></body></worldbody></mujoco>",
            "free",
        ),
        (
            "<mujoco><worldbody><body><joint type='ball' name='hip'/><geom size='0.1'/></body></worldbody></mujoco>",
            "joint hip.type",
        ),
        ("<mujoco><worldbody><body name='empty'><joint/></body></worldbody></mujoco>", "link empty"),
        ("<mujoco><worldbody><body><joint axis='0 0 0'/></body></worldbody></mujoco>", "axis"),
        ("<mujoco/>", "no hinge or slide"),
        ("<robot><link name='a'/><link name='b'/></robot>", "2 links without a parent"),
        ("<svg/>", "<svg>"),
        ("nothing", "XML"),
    ] {
        let error = mechanism_from_xml(text).unwrap_err().to_string();
        assert!(error.contains(reason), "{error} for {reason}");
    }
}
