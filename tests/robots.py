"""Stand-ins for published robots: their kinematics and names, written here, without meshes."""

PANDA = """
<mujoco model="panda">
  <compiler angle="radian"/>
  <option integrator="implicitfast"/>
  <default>
    <geom type="capsule" size="0.04" contype="0" conaffinity="0"/>
    <joint armature="0.1" damping="1" axis="0 0 1" range="-2.8973 2.8973"/>
    <general dyntype="none" biastype="affine" ctrlrange="-2.8973 2.8973" forcerange="-87 87"/>
    <default class="finger">
      <joint axis="0 1 0" type="slide" range="0 0.04"/>
      <geom type="box" size="0.01 0.01 0.03" mass="0.015"/>
    </default>
  </default>
  <worldbody>
    <body name="link0"><geom fromto="0 0 0.05 0 0 0.2" mass="0.6"/>
    <body name="link1" pos="0 0 0.333">
      <joint name="joint1"/><geom fromto="0 0 -0.1 0 0 0" mass="3"/>
    <body name="link2" quat="1 -1 0 0">
      <joint name="joint2" range="-1.7628 1.7628"/><geom fromto="0 0 0 0 -0.2 0" mass="3"/>
    <body name="link3" pos="0 -0.316 0" quat="1 1 0 0">
      <joint name="joint3"/><geom fromto="0 0 0 0.08 0 0" mass="3"/>
    <body name="link4" pos="0.0825 0 0" quat="1 1 0 0">
      <joint name="joint4" range="-3.0718 -0.0698"/><geom fromto="0 0 0 -0.08 0.2 0" mass="3"/>
    <body name="link5" pos="-0.0825 0.384 0" quat="1 -1 0 0">
      <joint name="joint5"/><geom fromto="0 0 -0.2 0 0 0" mass="2"/>
    <body name="link6" quat="1 1 0 0">
      <joint name="joint6" range="-0.0175 3.7525"/><geom fromto="0 0 0 0.08 0 0" mass="1.5"/>
    <body name="link7" pos="0.088 0 0" quat="1 1 0 0">
      <joint name="joint7"/><geom fromto="0 0 0 0 0 0.08" mass="0.7"/>
    <body name="hand" pos="0 0 0.107" quat="0.9238795 0 0 -0.3826834">
      <geom type="box" size="0.03 0.1 0.03" mass="0.7"/>
      <body name="left_finger" pos="0 0 0.0584">
        <joint name="finger_joint1" class="finger"/><geom class="finger"/>
      </body>
      <body name="right_finger" pos="0 0 0.0584" quat="0 0 0 1">
        <joint name="finger_joint2" class="finger"/><geom class="finger"/>
      </body>
    </body></body></body></body></body></body></body></body></body>
  </worldbody>
  <tendon>
    <fixed name="split">
      <joint joint="finger_joint1" coef="0.5"/><joint joint="finger_joint2" coef="0.5"/>
    </fixed>
  </tendon>
  <equality>
    <joint joint1="finger_joint1" joint2="finger_joint2" solimp="0.95 0.99 0.001" solref="0.005 1"/>
  </equality>
  <actuator>
    <general name="actuator1" joint="joint1" gainprm="4500" biasprm="0 -4500 -450"/>
    <general name="actuator2" joint="joint2" gainprm="4500" biasprm="0 -4500 -450"
      ctrlrange="-1.7628 1.7628"/>
    <general name="actuator3" joint="joint3" gainprm="3500" biasprm="0 -3500 -350"/>
    <general name="actuator4" joint="joint4" gainprm="3500" biasprm="0 -3500 -350"
      ctrlrange="-3.0718 -0.0698"/>
    <general name="actuator5" joint="joint5" gainprm="2000" biasprm="0 -2000 -200"
      forcerange="-12 12"/>
    <general name="actuator6" joint="joint6" gainprm="2000" biasprm="0 -2000 -200"
      forcerange="-12 12" ctrlrange="-0.0175 3.7525"/>
    <general name="actuator7" joint="joint7" gainprm="2000" biasprm="0 -2000 -200"
      forcerange="-12 12"/>
    <general name="actuator8" tendon="split" forcerange="-100 100" ctrlrange="0 255"
      gainprm="0.01568627451 0 0" biasprm="0 -100 -10"/>
  </actuator>
  <keyframe>
    <key name="home" qpos="0 0 0 -1.57079 0 1.57079 -0.7853 0.04 0.04"
      ctrl="0 0 0 -1.57079 0 1.57079 -0.7853 255"/>
  </keyframe>
</mujoco>
"""
"""Seven joints and a gripper whose fingers hang on one tendon and one gear."""

FINGER = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="one" pos="0 0 0.3">
      <joint name="one" axis="0 1 0" stiffness="0.4" springref="40" damping="0.02"
             armature="0.001"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0.05 0 0" mass="0.03"/>
      <site name="s1" pos="0.02 0 0.01"/>
      <body name="two" pos="0.05 0 0">
        <joint name="two" axis="0 1 0" stiffness="0.3" springref="30" damping="0.02"
               armature="0.001"/>
        <geom type="capsule" size="0.01" fromto="0 0 0 0.04 0 0" mass="0.02"/>
        <site name="s2" pos="0.02 0 0.01"/>
        <site name="tip" pos="0.04 0 0"/>
      </body>
    </body>
    <site name="s0" pos="-0.02 0 0.31"/>
  </worldbody>
  <tendon>
    <spatial name="cable"><site site="s0"/><site site="s1"/><site site="s2"/></spatial>
  </tendon>
  <actuator>
    <position name="pull" tendon="cable" kp="2000" kv="20" ctrlrange="0 0.2"/>
  </actuator>
</mujoco>
"""
"""A finger of two joints with springs, on one cable."""
