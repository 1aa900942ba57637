// A peer of the ROS 2 bridge that shares no code with it: it uses eProsima's Fast DDS
// and Fast CDR, with their defaults and the settings of rmw_fastrtps_cpp. Run it as
// `peer DOMAIN`.
//
// It reads orders as lines and answers each with a line:
//   grasp INT | kuka NUMBER...  publish a command
//   raw HEX                     publish these bytes on /grasp unchanged
//   joint_states | image        number of messages since the last time, and the fields of
//                               the last one (a checksum for an image's data)
//   matched                     number of readers of each command, writers of each topic

#include <cstring>
#include <functional>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;

#if __has_include(<fastdds/rtps/transport/UDPv4TransportDescriptor.hpp>)
#define FAST_DDS_3  // with Fast CDR 2, as in Debian 13
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.hpp>
namespace rtps = eprosima::fastdds::rtps;
constexpr auto kOk = RETCODE_OK;
constexpr auto kCdrVersion = eprosima::fastcdr::CdrVersion::DDS_CDR;
size_t length(const Cdr& cdr) { return cdr.get_serialized_data_length(); }
#else  // Fast DDS 2 with Fast CDR 1, as in Debian 12
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
namespace rtps = eprosima::fastrtps::rtps;
constexpr auto kOk = ReturnCode_t::RETCODE_OK;
constexpr auto kCdrVersion = Cdr::DDS_CDR;
size_t length(const Cdr& cdr) { return cdr.getSerializedDataLength(); }
#endif
using rtps::InstanceHandle_t;
using rtps::SerializedPayload_t;

struct Int32 {
  static constexpr const char* name = "std_msgs::msg::dds_::Int32_";
  static constexpr uint32_t size = 256;
  int32_t data = 0;
  std::string raw;  // sent instead of the data unless empty
  void write(Cdr& cdr) const { cdr << data; }
  void read(Cdr& cdr) { cdr >> data; }
};

struct Float64MultiArray {
  static constexpr const char* name = "std_msgs::msg::dds_::Float64MultiArray_";
  static constexpr uint32_t size = 1024;
  std::vector<double> data;
  std::string raw;
  void write(Cdr& cdr) const { cdr << uint32_t{0} << uint32_t{0} << data; }
  void read(Cdr&) {}
};

struct Header {
  int32_t sec;
  uint32_t nanosec;
  std::string frame_id;
  void read(Cdr& cdr) { cdr >> sec >> nanosec >> frame_id; }
};

struct JointState {
  static constexpr const char* name = "sensor_msgs::msg::dds_::JointState_";
  static constexpr uint32_t size = 16384;
  Header header;
  std::vector<std::string> names;
  std::vector<double> position, velocity, effort;
  std::string raw;
  void write(Cdr&) const {}
  void read(Cdr& cdr) {
    header.read(cdr);
    cdr >> names >> position >> velocity >> effort;
  }
  std::string text() const {
    std::ostringstream out;
    out << header.sec << " " << header.nanosec;
    for (const auto& n : names) out << " " << n;
    for (const auto* values : {&position, &velocity, &effort})
      for (double value : *values) out << " " << value;
    return out.str();
  }
};

struct Image {
  static constexpr const char* name = "sensor_msgs::msg::dds_::Image_";
  static constexpr uint32_t size = 1 << 20;
  Header header;
  uint32_t height, width, step;
  std::string encoding;
  uint8_t is_bigendian;
  std::vector<uint8_t> data;
  std::string raw;
  void write(Cdr&) const {}
  void read(Cdr& cdr) {
    header.read(cdr);
    cdr >> height >> width >> encoding >> is_bigendian >> step >> data;
  }
  std::string text() const {
    uint64_t sum = 0;
    for (size_t i = 0; i < data.size(); ++i) sum += (i % 251 + 1) * data[i];
    std::ostringstream out;
    out << header.frame_id << " " << height << " " << width << " " << encoding << " "
        << step << " " << data.size() << " " << sum;
    return out.str();
  }
};

template <class M>
class RosType : public TopicDataType {
 public:
#ifdef FAST_DDS_3
  RosType() {
    set_name(M::name);
    max_serialized_type_size = M::size;
  }
  bool serialize(const void* const data, SerializedPayload_t& payload,
                 DataRepresentationId_t) override {
    return write(data, payload);
  }
  bool deserialize(SerializedPayload_t& payload, void* data) override {
    return read(payload, data);
  }
  uint32_t calculate_serialized_size(const void* const,
                                     DataRepresentationId_t) override {
    return M::size;
  }
  void* create_data() override { return new M; }
  void delete_data(void* data) override { delete static_cast<M*>(data); }
  bool compute_key(SerializedPayload_t&, InstanceHandle_t&, bool) override {
    return false;
  }
  bool compute_key(const void* const, InstanceHandle_t&, bool) override {
    return false;
  }
#else
  RosType() {
    setName(M::name);
    m_typeSize = M::size;
    auto_fill_type_object(false);
    auto_fill_type_information(false);
  }
  bool serialize(void* data, SerializedPayload_t* payload) override {
    return write(data, *payload);
  }
  bool deserialize(SerializedPayload_t* payload, void* data) override {
    return read(*payload, data);
  }
  std::function<uint32_t()> getSerializedSizeProvider(void*) override {
    return [] { return M::size; };
  }
  void* createData() override { return new M; }
  void deleteData(void* data) override { delete static_cast<M*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
#endif

 private:
  static bool write(const void* data, SerializedPayload_t& payload) {
    const M& message = *static_cast<const M*>(data);
    if (!message.raw.empty()) {
      payload.length = message.raw.size();
      std::memcpy(payload.data, message.raw.data(), message.raw.size());
      return true;
    }
    FastBuffer buffer(reinterpret_cast<char*>(payload.data), payload.max_size);
    Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, kCdrVersion);
    payload.encapsulation = CDR_LE;
    cdr.serialize_encapsulation();
    message.write(cdr);
    payload.length = length(cdr);
    return true;
  }
  static bool read(SerializedPayload_t& payload, void* data) {
    try {
      FastBuffer buffer(reinterpret_cast<char*>(payload.data), payload.length);
      Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, kCdrVersion);
      cdr.read_encapsulation();
      static_cast<M*>(data)->read(cdr);
      return true;
    } catch (const eprosima::fastcdr::exception::Exception& error) {
      std::cerr << M::name << ": " << error.what() << std::endl;
      return false;
    }
  }
};

// Without shared memory: Cyclone DDS does not support it, and it would stay behind in
// /dev/shm when a test kills this program.
DomainParticipantQos by_udp() {
  DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(
      std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>());
  return qos;
}

struct Peer {
  explicit Peer(uint32_t domain)
      : participant(DomainParticipantFactory::get_instance()->create_participant(
            domain, by_udp())),
        publisher(participant->create_publisher(PUBLISHER_QOS_DEFAULT)),
        subscriber(participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)) {}

  template <class M>
  Topic* topic(const std::string& name) {
    TypeSupport type(new RosType<M>());
    type.register_type(participant);
    return participant->create_topic("rt/" + name, M::name, TOPIC_QOS_DEFAULT);
  }
  template <class M>
  DataWriter* writer(const std::string& name) {
    DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
    qos.endpoint().history_memory_policy =
        rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    qos.data_sharing().off();
    qos.history().depth = 10;
    return publisher->create_datawriter(topic<M>(name), qos);
  }
  template <class M>
  DataReader* reader(const std::string& name, ReliabilityQosPolicyKind reliability) {
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    qos.endpoint().history_memory_policy =
        rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    qos.data_sharing().off();
    qos.reliability().kind = reliability;
    qos.history().depth = 10;
    return subscriber->create_datareader(topic<M>(name), qos);
  }

  DomainParticipant* participant;
  Publisher* publisher;
  Subscriber* subscriber;
};

template <class M>
std::string last(DataReader* reader) {
  M message;
  SampleInfo info;
  int count = 0;
  while (reader->take_next_sample(&message, &info) == kOk)
    if (info.valid_data) ++count;
  return std::to_string(count) + (count ? " " + message.text() : "");
}

std::string unhex(const std::string& digits) {
  std::string bytes;
  for (size_t i = 0; i + 1 < digits.size(); i += 2)
    bytes += static_cast<char>(std::stoi(digits.substr(i, 2), nullptr, 16));
  return bytes;
}

int main(int, char** argv) {
  Peer peer(std::stoul(argv[1]));
  DataWriter* grasp = peer.writer<Int32>("grasp");
  DataWriter* kuka = peer.writer<Float64MultiArray>("kuka");
  DataReader* joint_states =
      peer.reader<JointState>("joint_states", RELIABLE_RELIABILITY_QOS);
  DataReader* image =
      peer.reader<Image>("camera/color/image_raw", BEST_EFFORT_RELIABILITY_QOS);
  std::cout << "ready" << std::endl;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words(line);
    std::string order, answer;
    words >> order;
    if (order == "grasp" || order == "raw") {
      Int32 message;
      if (order == "grasp") {
        words >> message.data;
      } else {
        words >> answer;
        message.raw = unhex(answer);
      }
      answer = grasp->write(&message) ? "ok" : "failed";
    } else if (order == "kuka") {
      Float64MultiArray message;
      for (double value; words >> value;) message.data.push_back(value);
      answer = kuka->write(&message) ? "ok" : "failed";
    } else if (order == "joint_states") {
      answer = last<JointState>(joint_states);
    } else if (order == "image") {
      answer = last<Image>(image);
    } else if (order == "matched") {
      PublicationMatchedStatus written;
      SubscriptionMatchedStatus read;
      for (DataWriter* writer : {grasp, kuka}) {
        writer->get_publication_matched_status(written);
        answer += std::to_string(written.current_count) + " ";
      }
      for (DataReader* reader : {joint_states, image}) {
        reader->get_subscription_matched_status(read);
        answer += std::to_string(read.current_count) + " ";
      }
    }
    std::cout << answer << std::endl;
  }
  peer.participant->delete_contained_entities();
  DomainParticipantFactory::get_instance()->delete_participant(peer.participant);
}
